"""Control software gets to robots: the program for a Pi as one file, and ssh to many of them."""
