"""Server of Robotouille episodes over WebSocket."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robotouille_server.app import Server, serve
    from robotouille_server.runtime.settings import ServerSettings

__all__ = ["Server", "ServerSettings", "serve"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used; the substitutes' process needs few of them."""
    if name in ("Server", "serve"):
        from robotouille_server import app

        return getattr(app, name)
    if name == "ServerSettings":
        from robotouille_server.runtime.settings import ServerSettings

        return ServerSettings
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
