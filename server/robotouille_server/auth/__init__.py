"""Authentication and authorization: visitors, roles, tokens and signing keys."""

from robotouille_server.auth.private_files import read_private
from robotouille_server.auth.revocation import UsedTokens
from robotouille_server.auth.roles import (
    Role,
    check_join,
    check_opening,
    check_permission,
    check_scope,
    same_episode,
)
from robotouille_server.auth.tokens import (
    Credentials,
    ResumeGrant,
    RoleGrant,
    Tokens,
    key_file,
    revoked_file,
)
from robotouille_server.auth.visitors import (
    PROXY_HEADERS,
    AccessSettingError,
    CodeGuessLimiter,
    ConnectionLimiter,
    CountedConnection,
    TooManyConnectionsError,
    Visitor,
    comes_from,
    counted_as,
    is_address,
    newcomer_group,
    origin_refusal,
    parse_networks,
    parse_origins,
    visitor,
)

__all__ = [
    "PROXY_HEADERS",
    "AccessSettingError",
    "CodeGuessLimiter",
    "ConnectionLimiter",
    "CountedConnection",
    "Credentials",
    "ResumeGrant",
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
    "is_address",
    "key_file",
    "newcomer_group",
    "origin_refusal",
    "parse_networks",
    "parse_origins",
    "read_private",
    "revoked_file",
    "same_episode",
    "visitor",
]
