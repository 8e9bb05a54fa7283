"""Bytes in and out: WebSockets, TLS, and what their connections share."""
