"""Personal links: short role tokens for one seat."""

from __future__ import annotations

import base64
import hmac
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.join_codes import plain_token
from robotouille_server import Server
from robotouille_server.auth.keys import Key, Keyring, rotate
from robotouille_server.auth.links import Link, is_link, pack_link, read_link
from robotouille_server.auth.roles import Role
from robotouille_server.auth.tokens import Tokens
from robotouille_server.requests import Opening, open_episode
from tests.support.handshakes import hello, opened
from tests.support.servers import serving
from tests.support.thorough import thorough
from tests.support.virtual_time import virtual

KEY, OTHER = Key("a", b"x" * 32), Key("b", b"y" * 32)
CODE = "KQXZB-MHTWA"
SUBJECTS = st.one_of(
    st.text(min_size=1, max_size=64),
    st.from_regex(r"participant-[0-9a-f]{16}", fullmatch=True),
    st.from_regex(r"[0-9a-f]{16}-[1-9][0-9]?", fullmatch=True),
)
LINKS = st.builds(
    Link,
    code=st.from_regex(r"[A-Z]{5}-[A-Z]{5}", fullmatch=True),
    seat=st.sampled_from(["", "robot1", "robot16", "a-much-longer-name-of-a-seat", "s" * 64]),
    subject=SUBJECTS.filter(lambda text: len(text.encode()) < 70),
    expires=st.integers(1, 2**24 - 1).map(lambda hours: 3600.0 * hours),
    once=st.booleans(),
) | st.builds(
    Link,
    code=st.just(CODE),
    seat=st.just(""),
    subject=SUBJECTS.filter(lambda text: len(text.encode()) <= 64),
    expires=st.just(3600.0),
    once=st.booleans(),
    watch=st.just(True),
)


@thorough(60)
@given(LINKS)
def test_link_is_read_as_it_was_written(link: Link) -> None:
    token = pack_link(link, KEY)
    assert is_link(token)
    found = read_link(token, [OTHER, KEY])
    assert found is not None
    assert replace(found, token_id="") == replace(link, code=link.code.replace("-", ""))
    assert read_link(token, [OTHER]) is None


@thorough(30)
@given(LINKS)
def test_every_spelling_of_a_code_has_the_same_id(link: Link) -> None:
    """Otherwise, a revoked or used link would be valid again without its dash."""
    code, _, rest = pack_link(link, KEY).partition(".")
    plain = code.replace("-", "")
    spellings = (code, plain, code.lower(), f"-{plain}", f"{plain[:3]}--{plain[3:]}-")
    tokens = [f"{each}.{rest}" for each in spellings]
    found = [read_link(each, [KEY]) for each in tokens]
    assert len(set(map(plain_token, tokens))) == 1
    assert read_link(plain_token(tokens[0]), [KEY]) == found[0]
    assert len({each.token_id for each in found if each is not None}) == 1
    assert None not in found


@thorough(100)
@given(LINKS, st.data())
def test_changed_link_is_refused(link: Link, data: st.DataObject) -> None:
    token = pack_link(link, KEY)
    at = data.draw(st.integers(0, len(token) - 1))
    letter = data.draw(st.sampled_from("ABYZaz09-_.=+ \0"))
    changed = token[:at] + letter + token[at + 1 :]
    # The server ignores dashes and case in a code.
    code, dot, rest = changed.partition(".")
    same_code = code.replace("-", "").upper() == link.code.replace("-", "")
    if not (same_code and f"{dot}{rest}" == token[len(link.code) :]):
        assert read_link(changed, [KEY]) is None


@pytest.mark.parametrize("text", ["", ".", f"{CODE}.", "a.b.c", f"{CODE}.{'A' * 200}", CODE])
def test_other_texts_are_not_links(text: str) -> None:
    assert not is_link(text)
    assert read_link(text, [KEY]) is None


def test_link_for_a_seat_of_a_study_is_short() -> None:
    for subject in ("participant-0123456789abcdef", "0123456789abcdef-2"):
        token = pack_link(Link(CODE, "robot2", subject, 1.9e9), KEY)
        assert len(f"/play#{token}") <= 60


def test_link_for_a_spectator_grants_no_seat() -> None:
    tokens = Tokens(Keyring([KEY]), lambda: 0.0)
    grant = tokens.check_role(tokens.mint_link("p-1", seconds=60, code=CODE, watch=True))
    assert (grant.role, grant.subject, grant.seat) == (Role.SPECTATOR, "p-1", "")
    with pytest.raises(ValueError, match="a spectator has no seat"):
        tokens.mint_link("p-1", seconds=60, code=CODE, seat="robot1", watch=True)


def test_spectator_link_is_signed_for_watching_only() -> None:
    link = pack_link(Link(CODE, "", "p-1", 1.9e9, watch=True), KEY)
    signed = base64.urlsafe_b64decode(link.partition(".")[2] + "==")
    # A server without links for spectators checks this signature, and would grant any seat.
    of_player = b"robotouille/link\0" + CODE.replace("-", "").encode() + b"\0" + signed[:-12]
    assert hmac.digest(KEY.secret, of_player, "sha256")[:12] != signed[-12:]


def test_link_expires_at_a_whole_hour_and_can_be_revoked() -> None:
    now, revoked = [1.8e9], set[str]()
    tokens = Tokens(Keyring([KEY]), lambda: now[0], revoked)
    link = tokens.mint_link("p-1", seconds=1800, code=CODE, seat="robot1", once=True)
    grant = tokens.check_role(link)
    assert (grant.role, grant.subject, grant.episode) == ("player", "p-1", "KQXZBMHTWA")
    assert (grant.seat, grant.once) == ("robot1", True)
    assert 1800 <= grant.expires - now[0] < 1800 + 3600
    now[0] = grant.expires
    with pytest.raises(ProtocolError) as caught:
        tokens.check_role(link)
    assert caught.value.code == "auth/expired"
    now[0] -= 1
    revoked.add(grant.token_id)
    with pytest.raises(ProtocolError) as caught:
        tokens.check_role(link)
    assert caught.value.code == "auth/revoked"


@pytest.mark.parametrize(
    "fields", [{"code": "0123456789abcdef"}, {"code": CODE, "seat": "x" * 65}, {"code": ""}]
)
def test_invalid_values_make_no_link(fields: dict[str, str]) -> None:
    tokens = Tokens(Keyring([KEY]), lambda: 1.8e9)
    with pytest.raises(ValueError, match=r"episode|seat"):
        tokens.mint_link("p-1", seconds=60, **fields)


def study(server: Server, **options: object) -> messages.Created:
    request = messages.Create(task="multi_agent/01@2", tokens=True, **options)  # type: ignore[arg-type]
    _, created = open_episode(server.services, Opening(request=request, owner="lab", asker=()))
    return created


@virtual
async def test_link_gives_its_seat_and_brings_its_person_back(tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True, keys=tmp_path / "keys.json") as server:
        created = study(server, participants={"robot2": "P07"})
        assert set(created.links) == {"robot1", "robot2"}
        link = created.links["robot2"]
        own = f"http://127.0.0.1:{server.port}"
        join = {"type": "join", "episode": link.partition(".")[0]}
        async with opened(server, Origin=own) as phone, opened(server, Origin=own) as laptop:
            assert (await hello(phone, token=link))["role"] == "player"
            joined = await phone.ask(join, "joined")
            assert joined["seat"] == "robot2"
            assert (await hello(laptop, token=link, name="Robin"))["type"] == "welcome"
            assert (await laptop.ask(join, "joined"))["seat"] == "robot2"
            bye = await phone.receive()
            while bye["type"] != "bye":
                bye = await phone.receive()
            assert bye["code"] == "session/elsewhere"
            # The token of the same seat has the same subject, so it is the same person.
            async with opened(server) as window:
                await hello(window, token=created.tokens["robot2"])
                assert (await window.ask(join, "joined"))["seat"] == "robot2"
            other = {**join, "seat": "robot1"}
            async with opened(server) as thief:
                await hello(thief, token=link)
                assert (await thief.ask(other, "joined"))["code"] == "auth/seat"
        rotate(tmp_path / "keys.json", keep=1)
        async with opened(server, Origin=own) as late:
            assert (await hello(late, token=link))["code"] == "auth/invalid"


@virtual
async def test_person_returns_by_the_link_to_the_first_of_two_browsers(tmp_path: Path) -> None:
    """The resume token of the first browser no longer leads to the seat, but the link does."""
    async with serving(tmp_path) as server:
        link = study(server).links["robot1"]
        join = {"type": "join", "episode": link.partition(".")[0]}
        async with opened(server) as laptop:
            await hello(laptop, token=link)
            token = (await laptop.ask(join, "joined"))["resume"]
        async with opened(server) as phone:
            await hello(phone, token=link)
            await phone.ask(join, "joined")
            async with opened(server) as again:
                assert (await hello(again, resume=token))["type"] == "welcome"
                assert (await again.receive())["type"] == "left"
                assert (await again.ask(join, "joined"))["seat"] == "robot1"


@virtual
async def test_link_of_another_kitchen_is_refused(tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True) as server:
        first, second = study(server), study(server)
        async with opened(server) as connection:
            await hello(connection, token=first.links["robot1"])
            refused = await connection.ask({"type": "join", "episode": second.code}, "joined")
            assert refused["code"] == "auth/episode"
