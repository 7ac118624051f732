"""The client of a design service: what `mdesign submit`, `jobs`, `follow` and `fetch` share."""
