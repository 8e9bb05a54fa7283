"""The asyncio shell around episodes: connections, lobby, rooms, recordings, metrics."""

from robotouille_server.app import Server, serve
from robotouille_server.settings import ServerSettings

__all__ = ["Server", "ServerSettings", "serve"]
