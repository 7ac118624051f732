"""Routes on FSMs and on designs, which are FSMs that users keep."""
