"""Short work in worker processes, which may be killed: what users send is never computed in the service itself."""
