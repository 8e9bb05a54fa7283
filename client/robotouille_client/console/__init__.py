"""What the commands share: how they fail, how a server is named, and a seat that outlives them."""

from robotouille_client.console.command_line import (
    LenientOption,
    RenderingOption,
    TokenOption,
    check_look,
    explain,
    fail,
    failing,
    name_and_value,
    server_url,
    terminable,
)

__all__ = [
    "LenientOption",
    "RenderingOption",
    "TokenOption",
    "check_look",
    "explain",
    "fail",
    "failing",
    "name_and_value",
    "server_url",
    "terminable",
]
