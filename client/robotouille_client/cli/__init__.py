"""`robotouille`: everything that needs no server."""

from robotouille_client.cli.main import main

__all__ = ["main"]
