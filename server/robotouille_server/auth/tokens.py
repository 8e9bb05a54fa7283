"""Signed tokens (JWT, HS256).

Role tokens are made by an operator and state what their bearer may do. Resume tokens are made by
the server and bring a lost connection back to its seat. Their audience claims differ, so a
token of one kind cannot be used as the other.

A token contains everything that is needed to check it, so a restarted server and every process
with the same keys accept it. Time is an argument: this module reads no clock.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import secrets
from collections.abc import Callable, Container
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import jwt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille.errors import ProtocolError
from robotouille_server.auth.keys import FileKeyring, Keyring
from robotouille_server.auth.links import Link, is_link, pack_link, read_link
from robotouille_server.auth.replaced_tokens import ReplacedTokens
from robotouille_server.auth.revocation import REVOKED_FILE, Revocations, UsedTokens
from robotouille_server.auth.roles import Role
from robotouille_server.runtime.settings import ServerSettings

MAX_TOKEN_LENGTH = 2000
ALGORITHM = "HS256"
ROLE_AUDIENCE = "robotouille/role"
RESUME_AUDIENCE = "robotouille/resume"


@dataclass(frozen=True, slots=True)
class RoleGrant:
    """Content of a role token.

    Attributes:
        role: The role of the bearer.
        subject: The pseudonym of the bearer.
        name: The name to show, or empty.
        episode: The id or code of the only episode that the token is for, or empty.
        seat: The only seat that the token is for, or empty.
        expires: The end of the token in seconds since 1970.
        token_id: The id of the token, with which it can be revoked.
        once: True if the token is good for one session only.
    """

    role: Role
    subject: str
    name: str = ""
    episode: str = ""
    seat: str = ""
    expires: float = math.inf
    token_id: str = ""
    once: bool = False


@dataclass(frozen=True, slots=True)
class ResumeGrant:
    """Content of a resume token: a session, its place, and the limits of its role token.

    Attributes:
        session: The id of the session.
        episode: The id of the session's episode, or empty.
        seat: The first seat of the session, or empty.
        generation: The number of times the session has been resumed.
        name: The name of the participant.
        kind: The kind of the participant.
        role: The role of the session.
        expires: The end of the resume token in seconds since 1970.
        only_episode: The episode that the role token is limited to, or empty.
        only_seat: The seat that the role token is limited to, or empty.
        view: The view that the client has requested.
        participant: The pseudonym of the participant, if not the session's id.
        role_expires: The end of the role token, or 0 without a role token.
        token_id: The id of the role token, or empty.
    """

    session: str
    episode: str
    seat: str
    generation: int
    name: str
    kind: str
    role: Role
    expires: float = math.inf
    only_episode: str = ""
    only_seat: str = ""
    view: str = "state"
    participant: str = ""
    role_expires: float = 0.0
    token_id: str = ""

    @property
    def anonymous(self) -> bool:
        """True if the session was opened without a role token."""
        return self.role_expires == 0 and not self.token_id


_Text = Annotated[str, Field(max_length=64)]
_Name = Annotated[str, Field(max_length=40)]
_Time = Annotated[float, Field(allow_inf_nan=False)]


class _Claims(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, strict=True)

    sub: Annotated[str, Field(min_length=1, max_length=64)]
    name: _Name = ""
    role: Annotated[Role, Field(strict=False)]
    exp: _Time
    nbf: _Time = 0.0


class _RoleClaims(_Claims):
    episode: _Text = ""
    seat: _Text = ""
    jti: _Text = ""
    once: bool = False


class _ResumeClaims(_Claims):
    ep: _Text = ""
    seat: _Text = ""
    gen: Annotated[int, Field(ge=0)]
    kind: Annotated[str, Field(max_length=16)]
    oe: _Text = ""
    os: _Text = ""
    view: Annotated[str, Field(max_length=16)] = "state"
    pa: _Text = ""
    rx: _Time = 0.0
    ti: _Text = ""


_C = TypeVar("_C", bound=_Claims)

_EXPIRED = {
    "token": "the token has expired; ask the operator for a new one",
    "resume": "this connection cannot be resumed any more; send hello without 'resume'",
}


class _Utf8Encoder(json.JSONEncoder):
    """Encoder that leaves names outside ASCII as they are: escapes triple the size of a token."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{**options, "ensure_ascii": False})


class Tokens:
    """Signs and checks tokens.

    Args:
        keyring: The signing keys.
        wall: Returns the time in seconds since 1970.
        revoked: The ids of revoked role tokens. Resume tokens that derive from them are invalid,
            too.
    """

    def __init__(
        self, keyring: Keyring, wall: Callable[[], float], revoked: Container[str] = ()
    ) -> None:
        self._keyring = keyring
        self.revoked = revoked
        self._wall = wall
        self._jwt = jwt.PyJWT(
            options={
                "enforce_minimum_key_length": True,
                "strict_aud": True,
                # `_verified` checks these times with the server's clock, which tests replace. The
                # library would read the system's clock.
                "verify_exp": False,
                "verify_iat": False,
                "verify_nbf": False,
            }
        )

    def past(self, expires: float) -> bool:
        """Return whether a time of expiry has passed; 0 means no expiry."""
        return 0 < expires <= self._wall()

    # Role tokens

    def mint_role(
        self,
        role: Role,
        subject: str,
        *,
        seconds: float,
        name: str = "",
        episode: str = "",
        seat: str = "",
        once: bool = False,
    ) -> str:
        """Return a role token that is valid for `seconds`; raise ValueError for invalid values."""
        now = self._wall()
        # The id makes it possible to revoke one token of a subject.
        claims = {"sub": subject, "role": role.value, "jti": secrets.token_hex(8)}
        limits = {"name": name, "episode": episode, "seat": seat, "once": once}
        times = {"iat": int(now), "exp": math.ceil(now + seconds)}
        whole = {**claims, **{key: value for key, value in limits.items() if value}, **times}
        try:
            _RoleClaims.model_validate(whole)
        except ValidationError as error:
            fault = error.errors(include_input=False)[0]
            raise ValueError(f"{fault['loc'][0]}: {fault['msg']}") from None
        return self._signed(whole, ROLE_AUDIENCE)

    def check_role(self, token: str) -> RoleGrant:
        """Return the content of a role token.

        Raises:
            ProtocolError: `auth/invalid`, `auth/expired` or `auth/revoked`.
        """
        if is_link(token):
            return self._check_link(token)
        claims = self._verified(token, ROLE_AUDIENCE, _RoleClaims, "token")
        # Tokens from other programs may have no id. They must be revocable, too.
        token_id = claims.jti or _derived_id(token)
        self._check_revoked(token_id, "token")
        return RoleGrant(
            role=claims.role,
            subject=claims.sub,
            name=claims.name,
            episode=claims.episode,
            seat=claims.seat,
            expires=claims.exp,
            token_id=token_id,
            once=claims.once,
        )

    def mint_link(
        self,
        subject: str,
        *,
        seconds: float,
        code: str,
        seat: str = "",
        once: bool = False,
        watch: bool = False,
    ) -> str:
        """Return the token of a personal link to an episode, as `mint_role`.

        It grants the role `player`, or `spectator` with `watch`. Its validity is rounded up to a
        whole hour.
        """
        link = Link(code, seat, subject, self._wall() + seconds, once, watch)
        if not re.fullmatch(r"[A-Z-]{6,20}", code):
            raise ValueError("episode: a link needs the code of an episode, such as KQXZB-MHTWA")
        if not subject:
            raise ValueError("sub: expected a pseudonym")
        return pack_link(link, self._keyring.signing)

    # Resume tokens

    def mint_resume(self, grant: ResumeGrant, seconds: float) -> str:
        """Return a resume token that is valid for `seconds`; `grant.expires` is ignored."""
        claims = {
            # Short claim names: clients store these tokens and send them in each `hello`.
            "sub": grant.session, "ep": grant.episode, "seat": grant.seat,
            "gen": grant.generation, "name": grant.name, "kind": grant.kind,
            "role": grant.role.value, "exp": math.ceil(self._wall() + seconds),
        }  # fmt: skip
        optional = {
            "oe": grant.only_episode,
            "os": grant.only_seat,
            "view": grant.view if grant.view != "state" else "",
            "pa": grant.participant,
            "rx": grant.role_expires,
            "ti": grant.token_id,
        }
        claims |= {key: value for key, value in optional.items() if value}
        return self._signed(claims, RESUME_AUDIENCE)

    def check_resume(self, token: str) -> ResumeGrant:
        """Return the content of a resume token.

        The caller compares its generation with the session's.

        Raises:
            ProtocolError: `auth/invalid`, `auth/expired`, or `auth/revoked` if the session's role
                token was revoked.
        """
        claims = self._verified(token, RESUME_AUDIENCE, _ResumeClaims, "resume")
        self._check_revoked(claims.ti, "resume")
        return ResumeGrant(
            session=claims.sub,
            episode=claims.ep,
            seat=claims.seat,
            generation=claims.gen,
            name=claims.name,
            kind=claims.kind,
            role=claims.role,
            expires=claims.exp,
            only_episode=claims.oe,
            only_seat=claims.os,
            view=claims.view,
            participant=claims.pa,
            role_expires=claims.rx,
            token_id=claims.ti,
        )

    # Both

    def _check_link(self, token: str) -> RoleGrant:
        link = read_link(token, self._keyring.keys)
        if link is None:
            raise _invalid("the link is incomplete, or was signed with a retired key", "token")
        if self._wall() >= link.expires:
            raise ProtocolError("auth/expired", _EXPIRED["token"], "token")
        self._check_revoked(link.token_id, "token")
        return RoleGrant(
            role=Role.SPECTATOR if link.watch else Role.PLAYER,
            subject=link.subject,
            episode=link.code,
            seat=link.seat,
            expires=link.expires,
            token_id=link.token_id,
            once=link.once,
        )

    def _check_revoked(self, token_id: str, field: str) -> None:
        if token_id and token_id in self.revoked:
            text = "the operator has revoked this token; ask for a new one"
            raise ProtocolError("auth/revoked", text, field)

    def _signed(self, claims: dict[str, Any], audience: str) -> str:
        key = self._keyring.signing
        return self._jwt.encode(
            {"aud": audience, **claims},
            key.secret,
            algorithm=ALGORITHM,
            headers={"kid": key.kid},
            json_encoder=_Utf8Encoder,
        )

    def _verified(self, token: str, audience: str, model: type[_C], field: str) -> _C:
        """Return the claims of a token signed with one of the keys."""
        claims = _valid(self._decoded(token, audience, field), model, field)
        now = self._wall()
        if now >= claims.exp:
            raise ProtocolError("auth/expired", _EXPIRED[field], field)
        if now < claims.nbf:
            raise ProtocolError("auth/invalid", "the token is not valid yet", field)
        return claims

    def _decoded(self, token: str, audience: str, field: str) -> dict[str, Any]:
        # This check comes before any parsing, so that a long text costs nothing.
        if len(token) > MAX_TOKEN_LENGTH:
            raise _invalid(f"it is longer than {MAX_TOKEN_LENGTH} characters", field)
        # The decoder ignores padding, so one token could be written in several ways (RFC 7515, 2).
        if "=" in token:
            raise _invalid("it is not a signed token", field)
        try:
            key = self._keyring.find(jwt.get_unverified_header(token).get("kid"))
            if key is None:
                raise _invalid("it was signed with an unknown or retired key", field)
            claims: dict[str, Any] = self._jwt.decode(
                # A fixed algorithm: a token must not choose how it is verified (`"alg": "none"`).
                token,
                key.secret,
                algorithms=[ALGORITHM],
                audience=audience,
            )
        except (jwt.InvalidAudienceError, jwt.MissingRequiredClaimError):
            raise _invalid(f"it is not a {audience.partition('/')[2]} token", field) from None
        except jwt.InvalidSignatureError:
            raise _invalid("its signature is wrong", field) from None
        except (jwt.InvalidTokenError, ValueError, RecursionError):
            raise _invalid("it is not a signed token", field) from None
        return claims


def _valid(claims: dict[str, Any], model: type[_C], field: str) -> _C:
    try:
        return model.model_validate(claims)
    except ValidationError as error:
        fault = error.errors(include_input=False, include_url=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise _invalid(f"its claim {where!r}: {fault['msg']}", field) from None


def _derived_id(token: str) -> str:
    """Return an id for a token without one: a digest of the signed part, which cannot be varied."""
    signed = token.strip().rpartition(".")[0]
    return hashlib.sha256(signed.encode()).hexdigest()[:16]


def _invalid(why: str, field: str) -> ProtocolError:
    return ProtocolError("auth/invalid", f"invalid token: {why}", field)


@dataclass(frozen=True, slots=True)
class Credentials:
    """Tokens that a server signs and checks."""

    tokens: Tokens
    used: UsedTokens
    replaced: ReplacedTokens
    revoked: Revocations

    @classmethod
    def load(cls, settings: ServerSettings, wall: Callable[[], float]) -> Credentials:
        """Read the keys and revocations of the settings.

        Raises:
            RobotouilleError: The keys or the list of revoked tokens cannot be used.
        """
        revoked = Revocations(revoked_file(settings))
        tokens = Tokens(_keyring(settings), wall, revoked)
        state, seconds = settings.state_folder, settings.resume_hours * 3600
        replaced = ReplacedTokens(state / "replaced-tokens", seconds)
        return cls(tokens, UsedTokens(state / "used-tokens", wall), replaced, revoked)


def _keyring(settings: ServerSettings) -> Keyring:
    if settings.signing_keys is not None:
        return Keyring.parse(settings.signing_keys.get_secret_value())
    return FileKeyring(key_file(settings))


def revoked_file(settings: ServerSettings) -> Path:
    """Return the file with the ids of revoked tokens."""
    return key_file(settings).with_name(REVOKED_FILE)


def key_file(settings: ServerSettings) -> Path:
    """Return the file with the keys that sign tokens, which may not exist yet."""
    return settings.keys or settings.state_folder / "keys.json"
