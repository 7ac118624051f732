"""The pages of the service. They are made here, work without another server, and have no script in their text."""
