"""Users with their tokens, sessions of browsers, and the guard that checks every request."""
