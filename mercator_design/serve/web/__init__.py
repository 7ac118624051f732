"""The pages of the service. They load nothing from other servers, and have no inline scripts."""
