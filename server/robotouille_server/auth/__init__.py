"""Who somebody is and what they may do: visitors, roles, tokens and the keys that sign them."""

from robotouille_server.auth.keys import FileKeyring, Keyring
from robotouille_server.auth.private_files import read_private
from robotouille_server.auth.revocation import REVOKED_FILE, Revocations
from robotouille_server.auth.roles import (
    Role,
    check_join,
    check_opening,
    check_permission,
    check_scope,
    same_episode,
)
from robotouille_server.auth.tokens import ResumeGrant, RoleGrant, Tokens
from robotouille_server.auth.used_tokens import UsedTokens
from robotouille_server.auth.visitors import (
    PROXY_HEADERS,
    CodeGuessLimiter,
    ConnectionLimiter,
    CountedConnection,
    TooManyConnectionsError,
    Visitor,
    comes_from,
    counted_as,
    origin_refusal,
    parse_networks,
    parse_origins,
    visitor,
)

__all__ = [
    "PROXY_HEADERS",
    "REVOKED_FILE",
    "CodeGuessLimiter",
    "ConnectionLimiter",
    "CountedConnection",
    "FileKeyring",
    "Keyring",
    "ResumeGrant",
    "Revocations",
    "Role",
    "RoleGrant",
    "Tokens",
    "TooManyConnectionsError",
    "UsedTokens",
    "Visitor",
    "check_join",
    "check_opening",
    "check_permission",
    "check_scope",
    "comes_from",
    "counted_as",
    "origin_refusal",
    "parse_networks",
    "parse_origins",
    "read_private",
    "same_episode",
    "visitor",
]
