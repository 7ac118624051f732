"""Short work in helper processes, which may be killed: what users send is never computed in the service itself."""
