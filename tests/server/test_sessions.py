"""Resume tokens, missed messages and substitutes after a lost connection."""

from __future__ import annotations

import asyncio
import os
import shutil
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import Client, connect
from robotouille_server.auth.replaced_tokens import ReplacedTokens
from robotouille_server.auth.roles import Role
from robotouille_server.rooms.lobby import LINGER_SECONDS
from tests.support.handshakes import FORWARDED, opened
from tests.support.lost_connections import cut
from tests.support.servers import Raw, crash, raw, serving, with_clients
from tests.support.virtual_time import run, virtual

HELLO = {"type": "hello", "protocol": 1, "name": "ada"}
CREATE = {"type": "create", "task": "multi_agent/02"}


async def seated(client: Raw, task: str = "multi_agent/02", **options: object) -> dict:  # type: ignore[type-arg]
    created = await client.ask({"type": "create", "task": task, **options}, "created")
    return await client.ask({"type": "join", "episode": created["code"]}, "joined")


class TestResumeTokens:
    @virtual
    async def test_each_use_invalidates_earlier_tokens(self, tmp_path: Path) -> None:
        async with serving(tmp_path) as server:
            async with raw(server) as first:
                token = (await seated(first))["resume"]
            used = []
            for _ in range(3):
                async with raw(server, hello=False) as again:
                    welcome = await again.ask({**HELLO, "resume": token}, "welcome")
                    assert welcome["resumed"] is True
                    used.append(token)
                    token = welcome["resume"]
                    assert token not in used
            async with raw(server, hello=False) as thief:
                for old in used[:2]:
                    answer = await thief.ask({**HELLO, "resume": old}, "welcome")
                    assert (answer["code"], answer["field"]) == ("auth/expired", "resume")

    @pytest.mark.parametrize("ends", ["grace", "leave", "restart", "crash"])
    @virtual
    async def test_tokens_of_a_spectator_end_with_its_session(
        self, tmp_path: Path, ends: str
    ) -> None:
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(serving(tmp_path, grace=3))
            async with raw(server) as host:
                code = (await host.ask(CREATE, "created"))["code"]
                # A seat keeps the episode open.
                await host.ask({"type": "join", "episode": code}, "joined")
                watch = {"type": "join", "episode": code, "role": "spectator"}
                async with raw(server) as ada:
                    tokens = [(await ada.ask(watch, "joined"))["resume"]]
                for _ in range(3):
                    async with raw(server, hello=False) as again:
                        await again.ask({**HELLO, "resume": tokens[-1]}, "welcome")
                        tokens.append((await again.expect("joined"))["resume"])
                        if ends == "leave" and len(tokens) == 4:
                            await again.ask({"type": "leave"}, "left")
                if ends == "grace":
                    await asyncio.sleep(60)
                elif ends != "leave":
                    await (crash(server) if ends == "crash" else server.stop("", hand_over=True))
                    server = await stack.enter_async_context(serving(tmp_path, seed=2))
            for old in tokens:
                async with raw(server, hello=False) as late:
                    answer = await late.ask({**HELLO, "resume": old}, "welcome")
                    assert (answer.get("code"), answer.get("field")) == ("auth/expired", "resume")
                    # A client that may watch can join again.
                    await late.ask(HELLO, "welcome")
                    assert (await late.ask(watch, "joined"))["role"] == "spectator"

    @virtual
    async def test_token_replaced_before_its_session_took_a_seat_is_invalid_after_a_restart(
        self, tmp_path: Path
    ) -> None:
        async with serving(tmp_path) as server:
            async with raw(server) as host, raw(server) as ada:
                create = {"type": "create", "task": "multi_agent/02"}
                code = (await host.ask(create, "created"))["code"]
                watch = {"type": "join", "episode": code, "role": "spectator"}
                used = [(await ada.ask(watch, "joined"))["resume"]]
            for _ in range(2):
                async with raw(server, hello=False) as again:
                    await again.ask({**HELLO, "resume": used[-1]}, "welcome")
                    used.append((await again.expect("joined"))["resume"])
                    if len(used) == 3:
                        await again.ask({"type": "leave"}, "left")
                        play = {"type": "join", "episode": code}
                        joined = await again.ask(play, "joined")
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2) as server:
            async with raw(server, hello=False) as thief:
                answer = await thief.ask({**HELLO, "resume": used[0]}, "welcome")
                assert answer.get("code") == "auth/expired"
            async with raw(server, hello=False) as again:
                await again.ask({**HELLO, "resume": joined["resume"]}, "welcome")
                assert (await again.expect("joined"))["seat"] == joined["seat"]

    @virtual
    async def test_token_replaced_before_its_session_took_a_seat_over_is_invalid_after_a_restart(
        self, tmp_path: Path
    ) -> None:
        async with serving(tmp_path) as server:
            async with raw(server) as host:
                create = {"type": "create", "task": "multi_agent/02"}
                code = (await host.ask(create, "created"))["code"]
            role = server.tokens.mint_role(Role.PLAYER, "ada", seconds=60, episode=code)
            play = {"type": "join", "episode": code}
            async with raw(server, hello=False) as old, raw(server, hello=False) as one:
                await old.ask({**HELLO, "token": role}, "welcome")
                await old.ask(play, "joined")
                used = (await one.ask({**HELLO, "token": role}, "welcome"))["resume"]
                async with raw(server, hello=False) as two, raw(server, hello=False) as three:
                    last = (await two.ask({**HELLO, "resume": used}, "welcome"))["resume"]
                    await three.ask({**HELLO, "resume": last}, "welcome")
                    assert (await three.ask(play, "joined"))["seat"] == "robot1"
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2) as server:
            async with raw(server, hello=False) as thief:
                answer = await thief.ask({**HELLO, "resume": used}, "welcome")
                assert answer.get("code") == "auth/expired"

    @pytest.mark.parametrize("elsewhere", [False, True])
    @pytest.mark.parametrize("role", [Role.HOST, Role.PLAYER])
    @virtual
    async def test_token_replaced_after_the_end_is_invalid_after_a_restart(
        self, tmp_path: Path, role: Role, elsewhere: bool
    ) -> None:
        """Another node of a cluster shows the end again, but grants no role of a host."""
        async with serving(tmp_path) as server:
            async with raw(server) as host:
                code = (await host.ask(CREATE, "created"))["code"]
            token = server.tokens.mint_role(role, "ada", seconds=3600)
            async with raw(server, hello=False) as ada:
                await ada.ask({**HELLO, "token": token}, "welcome")
                used = [(await ada.ask({"type": "join", "episode": code}, "joined"))["resume"]]
            server.lobby.find(code).abort("over")
            for _ in range(2):
                async with raw(server, hello=False) as again:
                    await again.ask({**HELLO, "resume": used[-1]}, "welcome")
                    used.append((await again.expect("joined"))["resume"])
            await server.stop("restart", hand_over=True)
        if elsewhere:
            shutil.rmtree(server.settings.state_folder / "replaced-tokens")
        async with serving(tmp_path, seed=2) as server:
            async with raw(server, hello=False) as thief:
                answer = await thief.ask({**HELLO, "resume": used[0]}, "welcome")
                if role is Role.HOST or not elsewhere:
                    assert answer["code"] == "auth/expired"
                else:
                    assert (await thief.expect("snapshot"))["outcome"]["reason"] == "aborted"
            async with raw(server, hello=False) as ada:
                answer = await ada.ask({**HELLO, "resume": used[-1]}, "welcome")
                assert answer["type"] == ("error" if role is Role.HOST else "welcome")

    @virtual
    async def test_removal_after_the_end_survives_a_restart(self, tmp_path: Path) -> None:
        async with serving(tmp_path) as server:
            async with raw(server) as eve:
                tokens = [(await seated(eve))["resume"]]
                (room,) = server.lobby.rooms.values()
                room.abort("over")
            async with raw(server, hello=False) as again:
                await again.ask({**HELLO, "resume": tokens[-1]}, "welcome")
                tokens.append((await again.expect("joined"))["resume"])
                room.kick(room.members[0], "rude")
                await again.expect("left")
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2) as server:
            for token in tokens:
                async with raw(server, hello=False) as late:
                    answer = await late.ask({**HELLO, "resume": token}, "welcome")
                    assert answer.get("code") == "auth/expired"

    @virtual
    async def test_replaced_tokens_are_remembered_until_they_expire(self, tmp_path: Path) -> None:
        replaced = ReplacedTokens(tmp_path / "replaced", seconds=60)
        replaced.note("old", 3)
        (file,) = (tmp_path / "replaced").iterdir()
        os.utime(file, (0, 0))
        replaced = ReplacedTokens(tmp_path / "replaced", seconds=60)
        replaced.note("new", 4)
        await asyncio.get_running_loop().shutdown_default_executor()
        assert (replaced.last_used("old"), replaced.last_used("new")) == (0, 4)

    @virtual
    async def test_unreadable_note_counts_for_every_token(self, tmp_path: Path) -> None:
        replaced = ReplacedTokens(tmp_path, seconds=60)
        replaced.note("ada", 3)
        (file,) = tmp_path.iterdir()
        file.write_text("three")
        assert replaced.last_used("ada") > 2**53

    @virtual
    async def test_token_replaced_after_the_end_stays_invalid_once_its_session_is_forgotten(
        self, tmp_path: Path
    ) -> None:
        async with serving(tmp_path, grace=3) as server:
            async with raw(server) as ada:
                tokens = [(await seated(ada))["resume"]]
                (room,) = server.lobby.rooms.values()
                room.abort("over")
            for _ in range(2):
                async with raw(server, hello=False) as again:
                    await again.ask({**HELLO, "resume": tokens[-1]}, "welcome")
                    tokens.append((await again.expect("joined"))["resume"])
            await asyncio.sleep(LINGER_SECONDS + 1)
            assert not server.lobby.rooms
            async with raw(server, hello=False) as thief:
                answer = await thief.ask({**HELLO, "resume": tokens[0]}, "welcome")
                assert answer.get("code") == "auth/expired"
            async with raw(server, hello=False) as late:
                await late.ask({**HELLO, "resume": tokens[-1]}, "welcome")
                assert (await late.expect("snapshot"))["outcome"]["reason"] == "aborted"

    @virtual
    async def test_token_with_a_lost_answer_is_valid_again(self, tmp_path: Path) -> None:
        async with serving(tmp_path) as server:
            async with raw(server) as first:
                token = (await seated(first))["resume"]
            for _ in range(3):
                async with raw(server, hello=False) as again:
                    welcome = await again.ask({**HELLO, "resume": token}, "welcome")
                    assert welcome["resumed"] is True

    @virtual
    async def test_resume_tokens_expire(self, tmp_path: Path) -> None:
        clock = [1_000_000.0]
        async with serving(tmp_path, wall=lambda: clock[0], resume_hours=1) as server:
            async with raw(server) as first:
                token = (await seated(first))["resume"]
            clock[0] += 3599
            async with raw(server, hello=False) as again:
                welcome = await again.ask({**HELLO, "resume": token}, "welcome")
                assert welcome["resumed"] is True
            clock[0] += 2
            async with raw(server, hello=False) as late:
                answer = await late.ask({**HELLO, "resume": token}, "welcome")
                assert answer["code"] == "auth/expired"

    @virtual
    async def test_forged_token_is_refused(self, tmp_path: Path) -> None:
        async with serving(tmp_path) as server, raw(server) as first:
            token = (await seated(first))["resume"]
            head, body, signature = token.split(".")
            async with raw(server, hello=False) as thief:
                for forged in (f"{head}.{body}.{signature[:-4]}AAAA", f"{head}.{body}.", "x"):
                    answer = await thief.ask({**HELLO, "resume": forged}, "welcome")
                    assert answer["code"] == "auth/invalid"

    @virtual
    async def test_token_is_for_its_own_seat(self, tmp_path: Path) -> None:
        """Also after a restart, when only the recording knows the seat's session."""
        async with serving(tmp_path) as server:
            async with raw(server) as ada, raw(server) as bob:
                joined = await seated(ada)
                other = await bob.ask({"type": "join", "episode": joined["code"]}, "joined")
                assert (joined["seat"], other["seat"]) == ("robot1", "robot2")
            await server.stop("restart", hand_over=True)
        async with serving(tmp_path, seed=2) as server:
            for token, seat in ((other["resume"], "robot2"), (joined["resume"], "robot1")):
                async with raw(server, hello=False) as again:
                    await again.ask({**HELLO, "resume": token}, "welcome")
                    assert (await again.expect("joined"))["seat"] == seat


class TestMissedMessages:
    @virtual
    async def test_only_missed_deltas_and_chat_are_sent(self, tmp_path: Path) -> None:
        async with serving(tmp_path) as server, raw(server) as bob:
            async with raw(server) as ada:
                joined = await seated(ada)
                await bob.ask({"type": "join", "episode": joined["code"]}, "joined")
                await ada.send({"type": "say", "text": "one"})
                said = await ada.expect("said")
                await ada.send({"type": "act", "seq": 1, "action": None})
                await bob.send({"type": "act", "seq": 1, "action": None})
                assert (await ada.expect("delta"))["step"] == 1
            assert (await bob.expect("delta"))["step"] == 1
            await asyncio.sleep(0.1)
            for seq in (2, 3):
                await bob.send({"type": "act", "seq": seq, "action": None})
                assert (await bob.expect("delta"))["step"] == seq
            await bob.send({"type": "say", "text": "two"})
            await bob.expect("said")
            seen = {"episode": joined["episode"], "step": 1, "said": said["number"]}
            async with raw(server, hello=False) as again:
                hello = {**HELLO, "resume": joined["resume"], "seen": seen}
                await again.ask(hello, "welcome")
                received = []
                while not received or received[-1]["type"] != "roster" or len(received) < 4:
                    received.append(await again.receive())
                kinds = [m["type"] for m in received if m["type"] != "roster"]
                assert kinds == ["joined", "delta", "delta", "said"]
                assert [m["step"] for m in received if m["type"] == "delta"] == [2, 3]
                assert [m["text"] for m in received if m["type"] == "said"] == ["two"]

    @virtual
    async def test_joined_is_the_first_message_of_the_episode(self, tmp_path: Path) -> None:
        async with serving(tmp_path) as server:
            async with raw(server) as first:
                joined = await seated(first)
            async with raw(server, hello=False) as again:
                await again.ask({**HELLO, "resume": joined["resume"]}, "welcome")
                assert (await again.receive())["type"] == "joined"


async def two_people(ada: Client, bob: Client, **options: object):  # type: ignore[no-untyped-def]
    # Without a move budget, no timer ends a step while a substitute plans.
    created = await ada.create("training/03_multi_agent@2", **{"move_budget": 0, **options})
    return await ada.join(created.code), await bob.join(created.code)


class TestSubstitute:
    @virtual
    async def test_substitute_acts_in_the_next_step_and_returns_the_seat(
        self, tmp_path: Path
    ) -> None:
        async with serving(tmp_path) as server, connect(server.url, name="bob") as bob:
            ada = Client(server.url, name="ada", kind="human")
            async with ada:
                one, two = await two_people(ada, bob, absence="bot", substitute="planner")
                await asyncio.gather(one.act(None), two.act(None))
                ada.protocol.reconnect = False
                cut(ada)
                await asyncio.sleep(0.5)
                assert [s.controller for s in two.seats] == ["substitute", "bot"]
                for _ in range(10):
                    await two.act(None)
                assert ada.game is not None
                async with raw(server, hello=False) as back:
                    await back.ask({**HELLO, "resume": ada.resume}, "welcome")
                    joined = await back.expect("joined")
                    assert joined["seat"] == "robot1"
                    await asyncio.sleep(0.5)
                    assert [s.controller for s in two.seats] == ["human", "bot"]
        (file,) = tmp_path.glob("*.rbt")
        recording = read_recording(file)
        assert recording.verify().ok
        moves = {f["step"]: [(m["player"], m["seq"]) for m in f["moves"]] for f in recording.steps}
        assert moves[1] == []
        assert moves[2] == [("robot1", 0)], "not in the next step"
        assert sum(bool(m) for m in moves.values()) >= 5
        controllers = [n["controller"] for n in recording.notes() if n.get("player") == "robot1"]
        assert controllers == ["human", "substitute", "human", "substitute"]

    @pytest.mark.slow
    def test_substitute_reaches_the_goal(self, tmp_path: Path) -> None:

        async def main() -> dict:  # type: ignore[type-arg]
            async with with_clients(tmp_path, "eve", grace=600) as (server, eve):
                async with raw(server) as ada:
                    options = {"absence": "bot", "clock": "lockstep"}
                    joined = await seated(ada, "multi_agent/01", **options)
                    other = await eve.join(joined["code"])
                    assert other.seat == "robot2"
                while not other.ended:
                    await other.act(None)
                return dict(other.outcome or {})

        outcome = run(main())
        assert outcome["reason"] == "goal"


@virtual
async def test_pause_shows_the_remaining_grace(tmp_path: Path) -> None:
    async with serving(tmp_path, grace=20) as server, connect(server.url, name="bob") as bob:
        async with raw(server) as ada:
            joined = await seated(ada, clock="realtime", absence="pause", grace=12)
            game = await bob.join(joined["code"])
            while game.step < 3:
                await asyncio.sleep(0.1)
        await asyncio.sleep(5)
        assert game.pause is not None
        assert (game.pause.reason, game.phase) == ("absence", "paused")
        assert 11 < (game.pause.left or 0) <= 12
        await asyncio.sleep(8)
        assert game.outcome is not None
        assert (game.outcome["reason"], game.outcome["detail"]) == (
            "abandoned",
            "raw did not come back",
        )


HOUR = 3600.0


@virtual
async def test_resuming_does_not_prolong_a_role(tmp_path: Path) -> None:
    now = [1_800_000_000.0]
    async with serving(tmp_path, wall=lambda: now[0], require_token=True) as server:
        token = server.tokens.mint_role(Role.HOST, "carol", seconds=int(HOUR))
        hello = {"type": "hello", "protocol": 1, "name": "carol"}
        async with raw(server, hello=False) as one:
            welcome = await one.ask({**hello, "token": token}, "welcome")
            assert welcome["role"] == "host"
            created = await one.ask({"type": "create", "grace": 86400.0}, "created")
            joined = await one.ask({"type": "join", "episode": created["code"]}, "joined")
        resume = joined["resume"]
        for hours, role in [(0.5, "host"), (0.6, "player"), (20, "player"), (20, "player")]:
            now[0] += hours * HOUR
            async with raw(server, hello=False) as one:
                welcome = await one.ask({**hello, "resume": resume}, "welcome")
                assert (welcome["resumed"], welcome["role"]) == (True, role)
                assert (await one.expect("joined"))["seat"] == joined["seat"]
                answer = await one.ask({"type": "create"}, "created")
                assert (answer.get("code") == "auth/role") is (role == "player")
            resume = welcome["resume"]


@pytest.mark.parametrize(
    ("sight", "answers"),
    [(None, ["host", "player"]), (2, ["host", "auth/expired"])],
    ids=["whole kitchen", "limited sight"],
)
@pytest.mark.parametrize("with_token", [True, False], ids=["token expires", "from elsewhere"])
@virtual
async def test_host_who_comes_back_as_a_player_watches_no_game_with_limited_sight(
    tmp_path: Path, sight: int | None, answers: list[str], *, with_token: bool
) -> None:
    now, found = [1_800_000_000.0], []
    async with serving(tmp_path, wall=lambda: now[0]) as server:
        token = server.tokens.mint_role(Role.HOST, "carol", seconds=int(HOUR))
        async with opened(server) as host:
            await host.ask({**HELLO, **({"token": token} if with_token else {})}, "welcome")
            code = (await host.ask({**CREATE, "sight": sight}, "created"))["code"]
            watch = {"type": "join", "episode": code, "role": "spectator"}
            resume = (await host.ask(watch, "joined"))["resume"]
        for headers in ({}, {} if with_token else FORWARDED):
            async with opened(server, **headers) as host:
                answer = await host.ask({**HELLO, "resume": resume}, "welcome")
            found.append(answer.get("role") or answer["code"])
            resume = answer.get("resume")
            now[0] += 2 * HOUR
    assert found == answers
