"""The verbs of `mdesign` that run the service, and those that use one."""
