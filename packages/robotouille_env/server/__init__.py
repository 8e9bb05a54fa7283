"""HTTP server of the environment."""
