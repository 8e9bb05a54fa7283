"""Episodes of studies: reservations, labels, seat tokens and join codes."""

from __future__ import annotations

import asyncio
import json
import random
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.messages import Create, Notice
from robotouille.replay.recording import read_recording
from robotouille_server import ServerSettings, serve
from robotouille_server.app import Surroundings
from robotouille_server.auth.roles import Role
from robotouille_server.rooms import room_factory
from robotouille_server.rooms.publishing.publisher import abandoned_text
from robotouille_server.rooms.room_factory import JoinCodes, UnusedCode
from robotouille_server.runtime.workers import WorkerSlot
from tests.support.handshakes import FORWARDED, hello, mint_token, opened
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import run, virtual

LABELS = {"condition": "bot", "pair": "p7"}
CREATE = {"type": "create", "task": "multi_agent/01", "open_for": 86_400.0, "labels": LABELS}
HOUR, DAY = 3_600.0, 86_400.0


class Wall:
    """Time of day that a test sets."""

    def __init__(self) -> None:
        self.now = 1_800_000_000.0

    def __call__(self) -> float:
        return self.now


async def host(connection: Raw, token: str) -> None:
    assert (await hello(connection, token=token))["type"] == "welcome"


@pytest.mark.slow
@virtual
async def test_reservation_survives_a_restart_and_ends_in_time(tmp_path: Path) -> None:
    wall = Wall()
    async with serving(tmp_path, wall=wall) as first, opened(first) as lab:
        await host(lab, mint_token(first, Role.HOST, seconds=10 * DAY))
        study = {"open_for": HOUR, "chat": "off", "treatments": {"robot2": {"delay_ms": 40}}}
        code = (await lab.ask({**CREATE, **study}, "created"))["code"]
        await asyncio.sleep(300.0)
        await crash(first)
    wall.now += HOUR / 2
    async with serving(tmp_path, seed=2, wall=wall) as second, opened(second) as lab:
        await host(lab, mint_token(second, Role.HOST, seconds=10 * DAY))
        (listed,) = (await lab.ask({"type": "list"}, "episodes"))["episodes"]
        assert listed["code"] == code
        assert listed["labels"] == LABELS
        episode = second.lobby.find(code).episode
        assert episode.rules.chat == "off"
        assert episode.seat("robot2").treatment.delay_ms == 40
        assert listed["closes"] == pytest.approx(HOUR / 2, abs=20.0)
        await asyncio.sleep(HOUR / 2 + 300.0)
        late = await lab.ask({"type": "join", "episode": code}, "joined")
        assert late["code"] == "episode/ended"
        assert "nobody came" in late["message"]
        answer = await lab.ask({"type": "list", "closed": True}, "episodes")
        assert [(one["code"], one["detail"]) for one in answer["episodes"]] == [
            (code, "nobody came")
        ]
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.header["labels"] == LABELS
    assert recording.outcome is not None
    assert recording.outcome["seconds"] == 0.0  # It never began.
    assert recording.verify().ok


@virtual
async def test_token_for_one_episode_lists_no_other_closed_episodes(tmp_path: Path) -> None:
    closed = {"type": "list", "closed": True}
    async with serving(tmp_path) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        for condition in ("bot", "human"):
            asked = {**CREATE, "labels": {"condition": condition}}
            opened_last = await lab.ask(asked, "created")
            await lab.ask({"type": "close", "episode": opened_last["code"]}, "closed")
        assert (await lab.ask(closed, "episodes"))["total"] == 2
        for role, subject, only in (
            (Role.OPERATOR, "o", opened_last["episode"]),
            (Role.HOST, "p-1", opened_last["code"]),
        ):
            token = server.tokens.mint_role(role, subject, seconds=60, episode=only)
            async with opened(server) as limited:
                await host(limited, token)
                (seen,) = (await limited.ask(closed, "episodes"))["episodes"]
                assert seen["labels"] == {"condition": "human"}


@virtual
async def test_labels_are_shown_to_owner_and_operators(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, opened(server) as lab, opened(server) as other:
        await host(lab, mint_token(server, Role.HOST))
        await host(other, server.tokens.mint_role(Role.HOST, "p-2", seconds=60))
        await lab.ask(CREATE, "created")
        asked = {"type": "list", "labels": {"condition": "bot"}}
        assert (await lab.ask(asked, "episodes"))["total"] == 1
        wrong = {"type": "list", "labels": {"condition": "human"}}
        assert (await lab.ask(wrong, "episodes")).get("total", 0) == 0
        assert (await other.ask(asked, "episodes")).get("total", 0) == 0
        (seen,) = (await other.ask({"type": "list"}, "episodes"))["episodes"]
        assert "labels" not in seen
        async with opened(server) as operator:
            await host(operator, server.tokens.mint_role(Role.OPERATOR, "o", seconds=60))
            assert (await operator.ask(asked, "episodes"))["total"] == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("labels", {"a\nb": "c"}),
        ("labels", {"a": "c\x1b[2J"}),
        ("labels", {"a": ""}),
        ("labels", {f"a{n}": "b" for n in range(17)}),
        ("open_for", 91 * DAY),
        ("open_for", 59.0),
        ("phrases", ["Hello"]),
        ("chat", "phrases"),
        ("treatments", {"robot9": {"shown_as": "bot"}}),
        ("treatments", {"robot1": {"delay_ms": -1}}),
        ("treatments", {"robot1": {"shown_as": "ghost"}}),
    ],
)
@virtual
async def test_invalid_options_are_refused(tmp_path: Path, field: str, value: Any) -> None:
    async with serving(tmp_path) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        refused = await lab.ask({**CREATE, field: value}, "created")
        assert refused["type"] == "error"
        assert field in refused["field"] or field == "chat"
        assert not server.lobby.rooms


@virtual
async def test_disguised_bot_is_not_revealed(tmp_path: Path) -> None:
    treated = {**CREATE, "treatments": {"robot2": {"shown_as": "human", "delay_ms": 40}}}
    async with serving(tmp_path) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        code = (await lab.ask({**treated, "labels": {}}, "created"))["code"]
        async with opened(server, **FORWARDED) as ada, opened(server, **FORWARDED) as bob:
            await hello(ada, kind="human")
            await hello(bob, name="bea", kind="bot")
            received = [await ada.ask({"type": "join", "episode": code}, "joined")]
            await bob.ask({"type": "join", "episode": code}, "joined")
            await bob.send({"type": "say", "text": "hi"})
            await bob.send({"type": "act", "seq": 1, "action": None, "waits": True})
            await ada.send({"type": "act", "seq": 1, "action": None})
            while received[-1]["type"] != "delta":
                received.append(await ada.receive())
            received.append(await ada.ask({"type": "resync"}, "snapshot"))
            listed = await lab.ask({"type": "list"}, "episodes")
            words = json.dumps([received, listed])
            assert {"said", "roster", "snapshot"} <= {message["type"] for message in received}
            for secret in ('"bot"', "shown_as", "delay_ms", "treatments", '"waits"'):
                assert secret not in words
            room = server.lobby.find(code)
            assert room.episode.seat("robot2").kind == "bot"
    recording = read_recording(next(tmp_path.glob("*.rbt*")))
    assert recording.header["treatments"]["robot2"] == {"shown_as": "human", "delay_ms": 40}
    assert recording.participants["robot2"] == ("bea", "bot")


@pytest.mark.parametrize("kind", ["human", "bot"])
@pytest.mark.parametrize("shown_as", ["human", "bot"])
@virtual
async def test_waits_of_a_disguised_seat_are_not_revealed(
    tmp_path: Path, kind: str, shown_as: str
) -> None:
    treatments = {"robot2": {"shown_as": shown_as}}
    async with serving(tmp_path) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        create = {**CREATE, "treatments": treatments, "clock": "lockstep", "max_steps": 2}
        code = (await lab.ask(create, "created"))["code"]
        room = server.lobby.find(code)
        async with opened(server, **FORWARDED) as ada, opened(server, **FORWARDED) as bob:
            await hello(ada, kind="bot")
            await hello(bob, name="bea", kind=kind)
            for client in (ada, bob):
                await client.ask({"type": "join", "episode": code}, "joined")
            for seq in (1, 2):
                await bob.send({"type": "act", "seq": seq, "action": None, "waits": True})
                await ada.send({"type": "act", "seq": seq, "action": None, "waits": True})
                assert (await ada.expect("delta"))["waits"] == [0]
            ended = (await ada.expect("ended"))["outcome"]
            assert [(s["waiting"], s["idle"]) for s in ended["seats"]] == [(2, 0), (0, 2)]
            assert (await ada.ask({"type": "resync"}, "snapshot"))["outcome"] == ended
            assert room.episode.outcome is not None
            assert [seat.waiting for seat in room.episode.outcome.seats] == [2, 2]
    recording = read_recording(next(tmp_path.glob("*.rbt*")))
    assert recording.outcome is not None
    assert [seat["waiting"] for seat in recording.outcome["seats"]] == [2, 2]


@virtual
async def test_time_to_the_next_step_does_not_reveal_a_delay(tmp_path: Path) -> None:
    treatments = {"robot2": {"delay_ms": 4_000}}
    async with serving(tmp_path) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        rules = {"clock": "lockstep", "move_budget": 60.0}
        create = {**CREATE, "treatments": treatments, **rules}
        code = (await lab.ask(create, "created"))["code"]
        room = server.lobby.find(code)
        async with opened(server, **FORWARDED) as ada, opened(server, **FORWARDED) as bob:
            for client, name in ((ada, "ada"), (bob, "bea")):
                await hello(client, name=name)
                await client.ask({"type": "join", "episode": code}, "joined")
            await bob.send({"type": "act", "seq": 1, "action": None})
            await asyncio.sleep(1.0)
            await ada.expect("snapshot")
            left = (await ada.ask({"type": "resync"}, "snapshot"))["left"]
            assert left == pytest.approx(59.0, abs=0.1)
            await ada.send({"type": "act", "seq": 1, "action": None})
            await asyncio.sleep(4.0)
            assert room.step == 1


@pytest.mark.parametrize("partner", [None, "human"])
@virtual
async def test_team_talk_does_not_reveal_a_disguised_bot(
    tmp_path: Path, partner: str | None
) -> None:
    """The partner claims to be a bot in `hello`, which anyone can do."""
    treatments = {"robot1": {"shown_as": partner}, "robot2": {"shown_as": "human"}}
    async with serving(tmp_path) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        code = (await lab.ask({**CREATE, "treatments": treatments}, "created"))["code"]
        async with opened(server, **FORWARDED) as bob:
            await hello(bob, name="bea", kind="bot")
            async with opened(server, **FORWARDED) as ada:
                await hello(ada, kind="bot")
                joined = await ada.ask({"type": "join", "episode": code}, "joined")
                await bob.ask({"type": "join", "episode": code}, "joined")
                note = {"type": "note", "topic": "team", "text": "planner 2"}
                await bob.send(note)
                assert (await bob.expect("told"))["seat"] == "robot2"
                await bob.send({"type": "say", "text": "hi"})
                assert "told" not in await types_until(ada, "said")
            # The texts that a bot has missed are sent to it when it comes back.
            await bob.send(note)
            await bob.expect("told")
            await bob.send({"type": "say", "text": "there?"})
            await bob.expect("said")
            async with opened(server, **FORWARDED) as ada:
                seen = {"episode": joined["episode"], "step": 0, "said": 1}
                resumed = {"type": "hello", "protocol": 1, "name": "ada"}
                await ada.ask({**resumed, "resume": joined["resume"], "seen": seen}, "welcome")
                await bob.send({"type": "say", "text": "again"})
                received = await types_until(ada, "said") + await types_until(ada, "said")
                assert "told" not in received


@virtual
async def test_bots_of_hosts_see_through_each_others_disguise(tmp_path: Path) -> None:
    """A bot with a player's token, and a host's program for people, see what people see."""
    treatments = {f"robot{number}": {"shown_as": "human"} for number in range(1, 5)}
    create = {**CREATE, "task": "multi_agent/10", "seats": 4, "treatments": treatments}
    async with serving(tmp_path) as server, AsyncExitStack() as stack:
        lab = await stack.enter_async_context(opened(server))
        await host(lab, mint_token(server, Role.HOST))
        code = (await lab.ask(create, "created"))["code"]
        kinds, heard = {}, {}
        clients = {}
        for name, kind, role in (
            ("one", "bot", Role.HOST),
            ("two", "bot", Role.HOST),
            ("eve", "bot", Role.PLAYER),
            ("ada", "human", Role.HOST),
        ):
            client = clients[name] = await stack.enter_async_context(opened(server, **FORWARDED))
            token = server.tokens.mint_role(role, name, seconds=3600)
            await hello(client, name=name, kind=kind, token=token)
            await client.ask({"type": "join", "episode": code}, "joined")
        for client in clients.values():
            await client.send({"type": "note", "topic": "team", "text": "planner 2"})
        await clients["ada"].send({"type": "say", "text": "done"})
        for name, client in clients.items():
            found = [await client.receive()]
            while found[-1]["type"] != "said":
                found.append(await client.receive())
            rosters = [message for message in found if message["type"] == "roster"]
            snapshot = await client.ask({"type": "resync"}, "snapshot")
            for seats in (rosters[-1]["seats"], snapshot["seats"]):
                kinds[name] = [seat["kind"] for seat in seats]
                assert [seat["controller"] for seat in seats] == kinds[name]
            heard[name] = [message["seat"] for message in found if message["type"] == "told"]
        people, team = ["human"] * 4, ["bot", "bot", "human", "human"]
        assert kinds == {"one": team, "two": team, "eve": people, "ada": people}
        both = ["robot1", "robot2"]
        assert heard == {"one": both, "two": both, "eve": ["robot3"], "ada": []}


async def types_until(client: Raw, last: str) -> list[str]:
    """Return the types of the messages up to the next one of the type `last`."""
    types: list[str] = []
    while last not in types:
        types.append((await client.receive())["type"])
    return types


@pytest.mark.slow
@virtual
async def test_many_creates_are_paced_up_to_the_limit(tmp_path: Path) -> None:
    limits = {"max_reserved_per_owner": 120, "max_episodes_per_owner": 1}
    async with serving(tmp_path, messages_per_second=20.0, **limits) as server:
        async with opened(server) as lab:
            await host(lab, mint_token(server, Role.HOST))
            began = asyncio.get_running_loop().time()
            for ref in range(420):
                await lab.send({**CREATE, "ref": ref})
            answers = [await lab.expect("created", "error") for _ in range(420)]
            assert [answer["ref"] for answer in answers] == list(range(420))
            assert {answer["type"] for answer in answers[:120]} == {"created"}
            assert {answer["code"] for answer in answers[120:]} == {"rate/episodes"}
            assert 10.0 < asyncio.get_running_loop().time() - began < 40.0
            one = {"type": "create", "task": "multi_agent/01"}
            assert (await lab.ask(one, "created"))["type"] == "created"
            assert (await lab.ask(one, "created"))["code"] == "rate/episodes"
            listed = (await lab.ask({"type": "list", "skip": 100}, "episodes"))["episodes"]
            assert len(listed) == 21


@virtual
async def test_seat_tokens_are_for_one_seat(tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True) as server, opened(server) as lab:
        await host(lab, mint_token(server, Role.HOST))
        created = await lab.ask({**CREATE, "tokens": True}, "created")
        other = await lab.ask(CREATE, "created")
        assert "tokens" not in other
        assert sorted(created["tokens"]) == ["robot1", "robot2"]
        async with opened(server) as ada:
            await hello(ada, token=created["tokens"]["robot2"])
            refused = await ada.ask({"type": "join", "episode": other["code"]}, "joined")
            assert refused["code"] == "auth/episode"
            joined = await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            assert joined["seat"] == "robot2"
            assert (await ada.ask(CREATE, "created"))["code"] == "auth/role"


@virtual
async def test_participant_has_one_pseudonym_per_owner(tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True) as server:
        pseudonyms = []
        for owner in ("lab", "lab", "other"):
            async with opened(server) as lab:
                await host(lab, server.tokens.mint_role(Role.HOST, owner, seconds=60))
                asked = {**CREATE, "tokens": True, "participants": {"robot1": "p01"}}
                tokens = (await lab.ask(asked, "created"))["tokens"]
                grants = [server.tokens.check_role(token) for token in tokens.values()]
                pseudonyms.append([grant.subject for grant in grants])
                unknown = {**CREATE, "participants": {"robot9": "p01"}}
                assert (await lab.ask(unknown, "created"))["field"] == "participants"
        (one, alone), (same, another), (strange, _) = pseudonyms
        assert one == same != strange
        assert alone != another
        assert "p01" not in one


@virtual
async def test_hosts_close_their_own_episodes_and_operators_any(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, opened(server) as lab, opened(server) as other:
        await host(lab, mint_token(server, Role.HOST))
        await host(other, server.tokens.mint_role(Role.HOST, "p-2", seconds=60))
        one, two = [(await lab.ask(CREATE, "created"))["code"] for _ in range(2)]
        assert (await other.ask({"type": "close", "episode": one}, "closed"))[
            "code"
        ] == "auth/episode"
        async with opened(server, **FORWARDED) as ada:
            await hello(ada)
            await ada.ask({"type": "join", "episode": one}, "joined")
            close = {"type": "close", "episode": one, "reason": "the lab is closed today"}
            assert (await lab.ask(close, "closed"))["type"] == "closed"
            ended = await ada.expect("ended")
            assert ended["outcome"]["detail"] == "the lab is closed today"
            assert (await ada.ask(close, "closed"))["code"] == "auth/role"
        async with opened(server) as operator:
            await host(operator, server.tokens.mint_role(Role.OPERATOR, "o", seconds=60))
            assert (await operator.ask({"type": "close", "episode": two}, "closed"))[
                "type"
            ] == "closed"


def test_message_about_many_who_left_can_be_sent() -> None:
    names = ", ".join(f"participant number {number}" for number in range(200))
    assert "participant number 1" in Notice(text=abandoned_text(f"{names} left")).text


@virtual
async def test_remaining_participant_is_told_what_to_do(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, opened(server) as ada, opened(server) as bob:
        await hello(ada)
        await hello(bob, name="bea")
        code = (await ada.ask({**CREATE, "absence": "end"}, "created"))["code"]
        for player in (ada, bob):
            await player.ask({"type": "join", "episode": code}, "joined")
        await bob.send({"type": "leave"})
        notice = await ada.expect("notice", "ended")
        assert notice["type"] == "notice"
        assert "bea left" in notice["text"]
        assert "another code" in notice["text"]
        assert (await ada.expect("ended"))["outcome"]["reason"] == "abandoned"


@virtual
async def test_seat_tokens_are_for_the_named_participants(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(Create(task="multi_agent/02"))
        services = server.services

        def subjects(owner: str, participants: dict[str, str]) -> list[str]:
            tokens = services.seat_tokens(room, participants, owner)
            grants = [services.tokens.check_role(token) for token in tokens.values()]
            assert {(grant.episode, grant.seat) for grant in grants} == {
                (room.id, player) for player in room.world.players
            }
            return [grant.subject for grant in grants]

        named, unnamed = subjects("lab", {"robot1": "p7"})
        assert unnamed == f"{room.id}-2"
        assert named == subjects("lab", {"robot1": "p7"})[0], "the same in all of their games"
        assert named != subjects("another lab", {"robot1": "p7"})[0]
        assert "p7" not in named


NAMES = ("session", "episode", "code")


def names(folder: Path, around: Surroundings | None = None) -> list[str]:
    """Return a new server's first ids and codes."""

    async def main() -> list[str]:
        settings = ServerSettings(port=0, recordings=folder)
        async with serve(settings, around) as server, raw(server, hello=False) as ada:
            hello = {"type": "hello", "protocol": 1, "name": "ada"}
            answers = [await ada.ask(hello, "welcome")]
            for _ in range(3):
                answers.append(await ada.ask({"type": "create"}, "created"))
            return [answer[name] for answer in answers for name in NAMES if name in answer]

    found: list[str] = run(main())
    return found


def test_equal_servers_use_different_ids_and_codes(tmp_path: Path) -> None:
    one, other = names(tmp_path / "one"), names(tmp_path / "other")
    assert len(one) == len(other) == 7
    assert len({*one, *other}) == 14


def test_all_ids_and_codes_come_from_the_systems_randomness(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = names(tmp_path / "known", Surroundings(randomness=random.Random(7)))
    assert names(tmp_path / "unknown") != known
    monkeypatch.setattr(random, "SystemRandom", lambda: random.Random(7))
    assert names(tmp_path / "system") == known


def unused(code: str) -> UnusedCode:
    info = messages.EpisodeInfo(
        episode=code.lower(),
        code=code,
        task="x",
        clock="turn",
        phase="ended",
        step=0,
        max_steps=1,
        seats=[],
        detail="nobody came",
    )
    return UnusedCode(info, "p-1")


def test_latest_unused_codes_are_remembered_in_any_spelling(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(room_factory, "MAX_CODES", 2)
    codes = JoinCodes(random.Random(1), WorkerSlot())
    for code in ("AAAAA-AAAAA", "BBBBB-BBBBB", "CCCCC-CCCCC"):
        codes.close_unused(unused(code))
    assert [one.info.code for one in codes.unused()] == ["BBBBB-BBBBB", "CCCCC-CCCCC"]
    codes.check_unused("aaaaaaaaaa")
    with pytest.raises(ProtocolError, match="BBBBB-BBBBB ended before it began: nobody came"):
        codes.check_unused("bbbbbbbbbb")
