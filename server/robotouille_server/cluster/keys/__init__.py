"""Signing keys, revoked tokens and used tokens that all nodes share."""
