"""The HTTP API, version 1: below /api/v1, described by /api/v1/openapi.json."""
