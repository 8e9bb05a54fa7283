"""Episodes of a study: opened by the hundred, kept open, labelled, blind, closed with a trace."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_server.auth.roles import Role
from tests.support.newcomers import FORWARDED, hello, minted, opened
from tests.support.servers import Raw, crash, serving
from tests.support.virtual_time import run

LABELS = {"condition": "bot", "pair": "p7"}
CREATE = {"type": "create", "task": "multi_agent/01", "open_for": 86_400.0, "labels": LABELS}
HOUR, DAY = 3_600.0, 86_400.0


class Wall:
    """The time of day, which a test sets."""

    def __init__(self) -> None:
        self.now = 1_800_000_000.0

    def __call__(self) -> float:
        return self.now


async def host(connection: Raw, token: str) -> None:
    assert (await hello(connection, token=token))["type"] == "welcome"


def test_a_code_outlives_a_restart_and_is_closed_when_its_time_is_over(tmp_path: Path) -> None:
    async def main() -> None:
        wall = Wall()
        async with serving(tmp_path, wall=wall) as first, opened(first) as lab:
            await host(lab, minted(first, Role.HOST, seconds=10 * DAY))
            study = {"open_for": HOUR, "chat": "off", "treatments": {"robot2": {"delay_ms": 40}}}
            code = (await lab.ask({**CREATE, **study}, "created"))["code"]
            await asyncio.sleep(300.0)
            await crash(first)
        wall.now += HOUR / 2
        async with serving(tmp_path, seed=2, wall=wall) as second, opened(second) as lab:
            await host(lab, minted(second, Role.HOST, seconds=10 * DAY))
            (listed,) = (await lab.ask({"type": "list"}, "episodes"))["episodes"]
            assert listed["code"] == code
            assert listed["labels"] == LABELS
            episode = second.lobby.find(code).episode
            assert episode.rules.chat == "off"
            assert episode.seat("robot2").treatment.delay_ms == 40
            assert listed["closes"] == pytest.approx(HOUR / 2, abs=20.0)
            await asyncio.sleep(HOUR / 2 + 300.0)
            late = await lab.ask({"type": "join", "episode": code}, "joined")
            assert late["code"] == "episode/over"
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

    run(main())


def test_labels_are_told_to_who_opened_it_and_to_operators(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, opened(server) as lab, opened(server) as other:
            await host(lab, minted(server, Role.HOST))
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

    run(main())


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
def test_what_cannot_be_is_refused_by_name(tmp_path: Path, field: str, value: Any) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, opened(server) as lab:
            await host(lab, minted(server, Role.HOST))
            refused = await lab.ask({**CREATE, field: value}, "created")
            assert refused["type"] == "error"
            assert field in refused["field"] or field == "chat"
            assert not server.lobby.rooms

    run(main())


def test_nothing_says_that_a_bot_is_shown_as_a_person(tmp_path: Path) -> None:
    treated = {**CREATE, "treatments": {"robot2": {"shown_as": "human", "delay_ms": 40}}}

    async def main() -> None:
        async with serving(tmp_path) as server, opened(server) as lab:
            await host(lab, minted(server, Role.HOST))
            code = (await lab.ask({**treated, "labels": {}}, "created"))["code"]
            async with opened(server, **FORWARDED) as ada, opened(server, **FORWARDED) as bob:
                await hello(ada, kind="human")
                await hello(bob, name="bea", kind="bot")
                heard = [await ada.ask({"type": "join", "episode": code}, "joined")]
                await bob.ask({"type": "join", "episode": code}, "joined")
                await bob.send({"type": "say", "text": "hi"})
                await bob.send({"type": "act", "seq": 1, "action": None})
                await ada.send({"type": "act", "seq": 1, "action": None})
                while heard[-1]["type"] != "delta":
                    heard.append(await ada.receive())
                heard.append(await ada.ask({"type": "resync"}, "snapshot"))
                listed = await lab.ask({"type": "list"}, "episodes")
                words = json.dumps([heard, listed])
                assert {"said", "roster", "snapshot"} <= {message["type"] for message in heard}
                for secret in ('"bot"', "shown_as", "delay_ms", "treatments"):
                    assert secret not in words
                room = server.lobby.find(code)
                assert room.episode.seat("robot2").kind == "bot"
        recording = read_recording(next(tmp_path.glob("*.rbt*")))
        assert recording.header["treatments"]["robot2"] == {"shown_as": "human", "delay_ms": 40}
        assert recording.participants["robot2"] == ("bea", "bot")

    run(main())


def test_a_burst_of_creates_is_paced_and_ends_at_the_owners_limit(tmp_path: Path) -> None:
    async def main() -> None:
        limits = {"max_reserved_per_owner": 120, "max_episodes_per_owner": 1}
        async with serving(tmp_path, messages_per_second=20.0, **limits) as server:
            async with opened(server) as lab:
                await host(lab, minted(server, Role.HOST))
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

    run(main())


def test_tokens_are_each_for_one_seat_of_one_episode(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, require_token=True) as server, opened(server) as lab:
            await host(lab, minted(server, Role.HOST))
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

    run(main())


def test_one_person_has_one_pseudonym_in_all_episodes_of_an_owner(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def test_hosts_close_their_own_and_operators_any(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, opened(server) as lab, opened(server) as other:
            await host(lab, minted(server, Role.HOST))
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

    run(main())


def test_the_partner_of_who_leaves_for_good_is_told_what_to_do(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())
