"""Signed tokens (JWT, HS256): who somebody is, and which session they come back to.

Two kinds, told apart by their audience, so that neither can serve as the other:

* **role tokens** are made by an operator and say what their bearer may do;
* **resume tokens** are made by the server and bring a lost connection back to its seat.

A token holds all that is needed to judge it, so a restarted server, or another process with the
same keys, takes it. Time is an argument: nothing here reads a clock.
"""

from __future__ import annotations

import hashlib
import json
import math
import secrets
from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import jwt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille.errors import ProtocolError
from robotouille_server.auth.keys import Keyring
from robotouille_server.auth.roles import Role

__all__ = ["MAX_TOKEN_LENGTH", "ResumeGrant", "Role", "RoleGrant", "Tokens"]

MAX_TOKEN_LENGTH = 2000
ALGORITHM = "HS256"
ROLE_AUDIENCE = "robotouille/role"
RESUME_AUDIENCE = "robotouille/resume"


@dataclass(frozen=True, slots=True)
class RoleGrant:
    """What a role token says; `episode` (id or code) and `seat` limit it unless empty.

    `token_id` names the token, so that it can be revoked; `once` says that a single session may
    join with it.
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
    """What a resume token says: a session, where it was, and how often it has been resumed.

    `only_episode` and `only_seat` are what the session's role token is limited to, `token_id`
    is its id, `role_expires` its end (0: there was none); `view` is how the session wants to see
    the game.
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
        """Whether the session has come in without a role token."""
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
    "resume": "this connection cannot be resumed any more; say hello without 'resume'",
}


class _Utf8Encoder(json.JSONEncoder):
    """Names outside ASCII as they are: escapes would make tokens up to three times as long."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{**options, "ensure_ascii": False})


class Tokens:
    """Makes and judges tokens. `wall` gives the time, in seconds since 1970; `revoked` are the
    ids of role tokens that are worth nothing any more, and with them what came of them."""

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
                "verify_exp": False,
                "verify_iat": False,
                "verify_nbf": False,
            }
        )

    def past(self, expires: float) -> bool:
        """Whether a time of expiry has come; 0 is none."""
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
        """A role token that is good for `seconds` from now; ValueError for what no token holds."""
        now = self._wall()
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
        """What a role token grants; ProtocolError `auth/invalid`, `auth/expired` or
        `auth/revoked` if nothing."""
        claims = self._verified(token, ROLE_AUDIENCE, _RoleClaims, "token")
        token_id = claims.jti or _made_up_id(token)
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

    # Resume tokens

    def mint_resume(
        self,
        *,
        session: str,
        generation: int,
        name: str,
        kind: str,
        role: Role,
        seconds: float,
        episode: str = "",
        seat: str = "",
        only_episode: str = "",
        only_seat: str = "",
        view: str = "state",
        participant: str = "",
        role_expires: float = 0.0,
        token_id: str = "",
    ) -> str:
        """A resume token of a session that is good for `seconds` from now."""
        claims = {
            "sub": session, "ep": episode, "seat": seat, "gen": generation, "name": name,
            "kind": kind, "role": role.value, "exp": math.ceil(self._wall() + seconds),
        }  # fmt: skip
        limits = {
            "oe": only_episode,
            "os": only_seat,
            "view": view if view != "state" else "",
            "pa": participant,
            "rx": role_expires,
            "ti": token_id,
        }
        claims |= {key: value for key, value in limits.items() if value}
        return self._signed(claims, RESUME_AUDIENCE)

    def check_resume(self, token: str) -> ResumeGrant:
        """What a resume token says; ProtocolError `auth/invalid` or `auth/expired` if nothing,
        `auth/revoked` where the role token is that its session came in with.

        Whether its generation is still the latest only the session knows.
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
        """The claims of a token that this server, or one with its keys, has signed."""
        claims = _valid(self._decoded(token, audience, field), model, field)
        now = self._wall()
        if now >= claims.exp:
            raise ProtocolError("auth/expired", _EXPIRED[field], field)
        if now < claims.nbf:
            raise ProtocolError("auth/invalid", "the token is not valid yet", field)
        return claims

    def _decoded(self, token: str, audience: str, field: str) -> dict[str, Any]:
        if len(token) > MAX_TOKEN_LENGTH:
            raise _invalid(f"longer than {MAX_TOKEN_LENGTH} characters", field)
        try:
            key = self._keyring.find(jwt.get_unverified_header(token).get("kid"))
            if key is None:
                raise _invalid(
                    "signed with a key that this server does not (any longer) use", field
                )
            claims: dict[str, Any] = self._jwt.decode(
                token, key.secret, algorithms=[ALGORITHM], audience=audience
            )
        except (jwt.InvalidAudienceError, jwt.MissingRequiredClaimError):
            raise _invalid(f"it is no {audience.partition('/')[2]} token", field) from None
        except jwt.InvalidSignatureError:
            raise _invalid("its signature is wrong", field) from None
        except (jwt.InvalidTokenError, ValueError, RecursionError):
            raise _invalid("it is not a token of this server", field) from None
        return claims


def _valid(claims: dict[str, Any], model: type[_C], field: str) -> _C:
    try:
        return model.model_validate(claims)
    except ValidationError as error:
        fault = error.errors(include_input=False, include_url=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise _invalid(f"its claim {where!r}: {fault['msg']}", field) from None


def _made_up_id(token: str) -> str:
    """The id of a token that has none: of what is signed, which nobody can write differently."""
    signed = token.strip().rpartition(".")[0]
    return hashlib.sha256(signed.encode()).hexdigest()[:16]


def _invalid(why: str, field: str) -> ProtocolError:
    return ProtocolError("auth/invalid", f"the token cannot be used: {why}", field)
