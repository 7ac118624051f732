"""The client of a design service, of `mdesign submit`, `jobs`, `follow` and `fetch`."""
