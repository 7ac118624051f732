"""Short work in worker processes, which may be killed: input of users is never computed in the service itself."""
