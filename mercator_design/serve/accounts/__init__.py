"""Who may do what: users with their tokens, sessions of the pages, and the guard in front of every request."""
