"""Role and resume tokens."""

from __future__ import annotations

import base64
import json
from typing import Any

import jwt
import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import ProtocolError
from robotouille_server.auth.keys import Key, Keyring
from robotouille_server.auth.roles import Role
from robotouille_server.auth.tokens import ResumeGrant, RoleGrant, Tokens

SECRET = bytes(range(32))
NOW = 1_800_000_000.0


class Clock:
    """Unix time that a test sets."""

    def __init__(self) -> None:
        self.now = NOW

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def tokens(clock: Clock) -> Tokens:
    return Tokens(Keyring([Key("a", SECRET)]), clock)


def resume(tokens: Tokens, **changes: Any) -> str:
    fields: dict[str, Any] = {
        "session": "aba0e01e30731b84",
        "generation": 3,
        "name": "ada",
        "kind": "human",
        "role": Role.PLAYER,
        "episode": "ad9ac0c99d4665c2",
        "seat": "robot1",
        "seconds": 60,
    }
    values = {**fields, **changes}
    seconds = values.pop("seconds")
    return tokens.mint_resume(ResumeGrant(**values), seconds)


def signed(claims: dict[str, Any], *, secret: bytes = SECRET, kid: Any = "a", **more: Any) -> str:
    """Return a token signed with another library."""
    whole = {"sub": "x", "role": "host", "aud": "robotouille/role", "exp": NOW + 9, **claims}
    whole = {key: value for key, value in whole.items() if value is not None}
    return jwt.encode(whole, secret, "HS256", headers={"kid": kid}, **more)


def refusal(tokens: Tokens, token: str, kind: str = "role") -> ProtocolError:
    with pytest.raises(ProtocolError) as caught:
        tokens.check_role(token) if kind == "role" else tokens.check_resume(token)
    assert caught.value.field == {"role": "token", "resume": "resume"}[kind]
    return caught.value


def test_role_token_round_trip(tokens: Tokens) -> None:
    token = tokens.mint_role(
        Role.PLAYER, "p-017", seconds=90, name="Zoë", episode="QWERTYUPAS", seat="robot2"
    )
    grant = tokens.check_role(token)
    assert grant.token_id
    assert grant == RoleGrant(
        Role.PLAYER, "p-017", "Zoë", "QWERTYUPAS", "robot2", NOW + 90, grant.token_id
    )
    again = tokens.check_role(tokens.mint_role(Role.PLAYER, "p-017", seconds=90))
    assert again.token_id != grant.token_id
    assert (again.name, again.episode, again.seat) == ("", "", "")


def test_resume_token_round_trip(tokens: Tokens) -> None:
    grant = tokens.check_resume(resume(tokens))
    assert grant == ResumeGrant(
        "aba0e01e30731b84", "ad9ac0c99d4665c2", "robot1", 3, "ada", "human", Role.PLAYER, NOW + 60
    )


def test_resume_token_keeps_the_limits_of_the_role_token(tokens: Tokens) -> None:
    grant = tokens.check_resume(resume(tokens, only_episode="QWERTYUPAS", only_seat="robot2"))
    assert (grant.only_episode, grant.only_seat) == ("QWERTYUPAS", "robot2")


def test_longest_tokens_fit_into_hello(tokens: Tokens) -> None:
    name, text = "𝄞" * 40, "x" * 64
    token = resume(
        tokens, session=text, episode=text, seat=text, name=name, only_episode=text, only_seat=text
    )
    assert len(token) <= 1000
    assert tokens.check_resume(token).name == name
    long = "𝄞" * 64
    role_token = tokens.mint_role(
        Role.OPERATOR, long, seconds=1, name=name, episode=long, seat=long
    )
    assert len(role_token) <= 2000
    assert tokens.check_role(role_token).subject == long


def test_kinds_of_tokens_are_not_interchangeable(tokens: Tokens) -> None:
    error = refusal(tokens, resume(tokens), "role")
    assert (error.code, "it is not a role token" in error.message) == ("auth/invalid", True)
    error = refusal(tokens, tokens.mint_role(Role.HOST, "x", seconds=9), "resume")
    assert (error.code, "it is not a resume token" in error.message) == ("auth/invalid", True)
    # Even one with all the claims of both: the audience alone decides.
    both = {"gen": 0, "kind": "human", "name": "x"}
    assert tokens.check_resume(signed({**both, "aud": "robotouille/resume"})).session == "x"
    assert refusal(tokens, signed(both), "resume").code == "auth/invalid"
    for audience in (None, "", ["robotouille/role", "robotouille/resume"], 3, {}):
        for kind in ("role", "resume"):
            assert refusal(tokens, signed({**both, "aud": audience}), kind).code == "auth/invalid"


def test_tokens_expire(tokens: Tokens, clock: Clock) -> None:
    role_token, resume_token = tokens.mint_role(Role.HOST, "x", seconds=60), resume(tokens)
    clock.now = NOW + 59.9
    tokens.check_role(role_token)
    tokens.check_resume(resume_token)
    clock.now = NOW + 60
    assert refusal(tokens, role_token).code == "auth/expired"
    assert refusal(tokens, resume_token, "resume").code == "auth/expired"


def test_token_without_an_end_is_refused(tokens: Tokens) -> None:
    for end in (None, "never", True, float("inf"), float("nan"), [], 10**400):
        assert refusal(tokens, signed({"exp": end})).code == "auth/invalid", end


def test_nbf_of_other_programs_is_respected(tokens: Tokens, clock: Clock) -> None:
    token = signed({"nbf": NOW + 5})
    assert "not valid yet" in refusal(tokens, token).message
    clock.now = NOW + 5
    assert tokens.check_role(token).role is Role.HOST


@pytest.mark.parametrize(
    "claims",
    [
        {"role": "root"},
        {"role": None},
        {"role": 1},
        {"sub": None},
        {"sub": ""},
        {"sub": "x" * 65},
        {"name": "x" * 41},
        {"name": 5},
        {"episode": ["a"]},
    ],
)
def test_invalid_claims_are_refused(tokens: Tokens, claims: dict[str, Any]) -> None:
    # Not every library lets such a token be made: the signature is put on by hand.
    token = signed({**claims, "sub": "x"}) if "sub" not in claims else by_hand(claims)
    error = refusal(tokens, token)
    assert error.code == "auth/invalid"


def by_hand(claims: dict[str, Any]) -> str:
    whole = {"sub": "x", "role": "host", "aud": "robotouille/role", "exp": NOW + 9, **claims}
    body = json.dumps({key: value for key, value in whole.items() if value is not None})
    return jwt.PyJWS().encode(body.encode(), SECRET, "HS256", headers={"kid": "a"})


def test_mint_refuses_invalid_values(tokens: Tokens) -> None:
    with pytest.raises(ValueError, match="sub: String should have at most 64"):
        tokens.mint_role(Role.HOST, "x" * 65, seconds=1)
    with pytest.raises(ValueError, match="name: String should have at most 40"):
        tokens.mint_role(Role.HOST, "x", name="x" * 41, seconds=1)


def test_old_keys_verify_until_dropped(clock: Clock) -> None:
    old, new = Key("old", SECRET), Key("new", bytes(40))
    token = Tokens(Keyring([old]), clock).mint_role(Role.HOST, "x", seconds=9)
    assert Tokens(Keyring([new, old]), clock).check_role(token).subject == "x"
    error = refusal(Tokens(Keyring([new]), clock), token)
    assert error.code == "auth/invalid"
    assert "unknown or retired key" in error.message
    newer = Tokens(Keyring([new, old]), clock).mint_role(Role.HOST, "x", seconds=9)
    assert jwt.get_unverified_header(newer) == {"alg": "HS256", "kid": "new", "typ": "JWT"}


def part(value: Any) -> str:
    raw = value if isinstance(value, bytes) else json.dumps(value).encode()
    return base64.urlsafe_b64encode(raw).decode().rstrip("=")


CLAIMS = {"sub": "x", "role": "operator", "aud": "robotouille/role", "exp": NOW + 9}


def test_other_algorithms_are_refused(tokens: Tokens) -> None:
    assert tokens.check_role(signed(CLAIMS)).role is Role.OPERATOR
    for name in ("none", "None", "NONE", "nOnE", ""):
        unsigned = f"{part({'alg': name, 'kid': 'a', 'typ': 'JWT'})}.{part(CLAIMS)}."
        assert refusal(tokens, unsigned).code == "auth/invalid", name
    for name in ("HS384", "HS512"):
        token = jwt.encode(CLAIMS, SECRET * 2, name, headers={"kid": "a"})
        assert refusal(tokens, token).code == "auth/invalid", name


def test_public_key_confusion_is_refused(clock: Clock) -> None:
    private = rsa.generate_private_key(65537, 2048)
    token = jwt.encode(CLAIMS, private, "RS256", headers={"kid": "a"})
    public = private.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    for secret in (SECRET, public):
        refused = Tokens(Keyring([Key("a", secret)]), clock)
        with pytest.raises(ProtocolError) as caught:
            refused.check_role(token)
        assert caught.value.code == "auth/invalid"


def test_keys_named_inside_the_token_are_not_used(tokens: Tokens) -> None:
    theirs = bytes(40)
    jwk = {"kty": "oct", "k": part(theirs)}
    for header in (
        {"jwk": jwk},
        {"jku": "https://evil.example/k"},
        {"x5u": "x"},
        {"crit": ["b64"]},
    ):
        token = jwt.encode(CLAIMS, theirs, "HS256", headers={"kid": "a", **header})
        assert refusal(tokens, token).code == "auth/invalid", header
    for kid in ("", "b", "../../dev/null", "a' or '1'='1"):
        assert refusal(tokens, signed(CLAIMS, kid=kid)).code == "auth/invalid", kid
    assert refusal(tokens, jwt.encode(CLAIMS, SECRET, "HS256")).code == "auth/invalid"


def test_changed_token_is_refused(tokens: Tokens) -> None:
    token = resume(tokens)
    for place in range(len(token) - 1):
        changed = "A" if token[place] != "A" else "B"
        assert refusal(tokens, token[:place] + changed + token[place + 1 :], "resume").code in (
            "auth/invalid",
        ), place
    head, body, signature = token.split(".")
    other = resume(tokens, seat="robot2").split(".")[1]
    assert refusal(tokens, f"{head}.{other}.{signature}", "resume").code == "auth/invalid"
    assert refusal(tokens, f"{head}.{body}.", "resume").code == "auth/invalid"


@given(st.text(max_size=300) | st.lists(st.binary(max_size=80), max_size=4).map(
    lambda parts: ".".join(base64.urlsafe_b64encode(p).decode() for p in parts)
))  # fmt: skip
def test_arbitrary_text_is_refused(text: str) -> None:
    tokens = Tokens(Keyring([Key("a", SECRET)]), lambda: NOW)
    assert refusal(tokens, text).code == "auth/invalid"
    assert refusal(tokens, text, "resume").code == "auth/invalid"


def test_hostile_tokens_are_refused(tokens: Tokens) -> None:
    nested = b"[" * 1400
    for token in (
        part(nested) + ".e30.x",
        f"{part({'alg': 'HS256', 'kid': 'a'})}.{part(b'[' * 700)}.x",
        "a" * 2001,
        "\ud800.\ud800.\ud800",
        "ä.ö.ü",
        "..",
        "",
        f"{part([1])}.{part({})}.x",
        f"{part({'alg': 'HS256', 'kid': ['a']})}.{part({})}.x",
        f"{part({'alg': ['HS256'], 'kid': 'a'})}.{part({})}.x",
        f"{part({'alg': 'HS256', 'kid': 'a', 'b64': False})}..x",
    ):
        assert refusal(tokens, token).code == "auth/invalid", token[:40]
