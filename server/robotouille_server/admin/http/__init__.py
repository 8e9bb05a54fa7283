"""The operator's port: HTTP API and page over the admin service."""
