"""Commands of laboratories: who may do what, what is answered and where, and what comes twice."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path
from typing import Any

import pytest

from robotouille_client import Announced, connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.auth.revocation import REVOKED_FILE, revoke
from robotouille_server.mqtt import commands as module
from robotouille_server.mqtt import outbox
from robotouille_server.mqtt.connection import Received
from robotouille_server.mqtt.models import COMMANDS, Answer
from robotouille_server.mqtt.topics import Topics
from robotouille_server.mqtt.watches import Watches
from tests.support.brokers import Lab, role_token, told
from tests.support.operator import table
from tests.support.virtual_time import run

ANSWERS = "robotouille/v1/lab/answers"


def audit(server: Server) -> list[dict[str, Any]]:
    return [json.loads(line) for line in server.audit.path.read_text().splitlines()]


def test_every_command_takes_a_role_and_has_a_handler() -> None:
    assert set(module.ROLES) == set(module.HANDLERS) == set(COMMANDS)


def test_episodes_are_opened_with_labels_and_tokens_and_played(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker, Role.HOST)
            create = {"task": "multi_agent/01", "labels": {"condition": "a"}, "tokens": True}
            answer = await lab.ask("open", count=3, create=create)
            assert answer.ok
            assert len({each.code for each in answer.opened}) == 3
            for opened in answer.opened:
                room = server.lobby.rooms[opened.episode]
                assert (room.labels, room.owner) == ({"condition": "a"}, "lab")
                assert set(opened.tokens) == {"robot1", "robot2"}
            seat = answer.opened[0].tokens["robot2"]
            async with connect(server.url, name="ada", token=seat) as client:
                game = await client.join(answer.opened[0].code)
                assert game.seat == "robot2"
            listed = await lab.ask("list", labels={"condition": "a"})
            assert {each.code for each in listed.episodes} == {e.code for e in answer.opened}
            assert listed.total == 3
            closed = await lab.ask("close", episode=answer.opened[1].code, reason="no pair")
            assert closed.ok
            assert [line["what"] for line in audit(server)] == ["mqtt open", "mqtt close"]
            assert {line["by"] for line in audit(server)} == {"lab"}

    run(main())


def test_an_operator_announces_pauses_and_resumes(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker), table(server) as play:
            lab = Lab(server, broker)
            assert (await lab.ask("announce", text="one")).ok
            assert (await play.hears(Announced)).text == "one"
            assert (await lab.ask("announce", text="two", episode=play.episode)).ok
            assert (await play.hears(Announced)).text == "two"
            assert (await lab.ask("pause", episode=play.code)).ok
            await play.until(lambda game: game.phase == "paused")
            assert (await lab.ask("resume", episode=play.episode)).ok
            await play.until(lambda game: game.phase == "running")
            assert await lab.refused("pause", episode="none") == "episode/unknown"
            lines = audit(server)
            done = ["announce to all", "announce", "pause", "resume"]
            assert [line["what"] for line in lines] == [*done, "mqtt pause"]
            assert lines[-1]["result"] == "episode/unknown"

    run(main())


@pytest.mark.parametrize(
    ("role", "refused"),
    [
        (Role.OPERATOR, set()),
        (Role.HOST, {"announce", "pause", "resume"}),
        (Role.PLAYER, {"announce", "pause", "resume", "watch", "list", "open", "close"}),
    ],
)
def test_a_role_may_do_so_much(tmp_path: Path, role: Role, refused: set[str]) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            opened = (await lab.ask("open")).opened[0].episode
            lab.token = role_token(server, role)
            asked: dict[str, dict[str, Any]] = {
                "watch": {},
                "list": {},
                "open": {},
                "announce": {"text": "hello"},
                "pause": {"episode": opened},
                "resume": {"episode": opened},
                "close": {"episode": opened},
            }
            for kind, fields in asked.items():
                answer = await lab.ask(kind, **fields)
                assert answer.ok == (kind not in refused), (kind, answer)
                assert answer.ok or (answer.error and answer.error.code == "auth/role")

    run(main())


def test_a_host_watches_and_closes_its_own_alone(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker), table(server) as play:
            lab = Lab(server, broker, Role.HOST)
            assert await lab.refused("watch", episode=play.episode) == "auth/episode"
            assert await lab.refused("close", episode=play.episode) == "auth/episode"
            assert (await lab.ask("watch")).ok, "of all that are its own"
            await play.until(lambda game: game.step >= 20)
            assert not broker.on("steps")
            assert not (await lab.ask("list")).episodes[0].labels

    run(main())


def test_a_token_for_one_episode_is_for_that(tmp_path: Path) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        began = time.time() - loop.time()
        clock = {"wall": lambda: began + loop.time()}
        async with told(tmp_path, **clock) as (server, broker), table(server) as play:
            lab = Lab(server, broker)
            lab.token = role_token(server, episode=play.episode)
            other = server.lobby.create(module.messages.Create())
            assert await lab.refused("open") == "auth/episode"
            assert await lab.refused("watch") == "auth/episode"
            assert await lab.refused("watch", episode=other.id) == "auth/episode"
            assert await lab.refused("pause", episode=other.id) == "auth/episode"
            assert await lab.refused("announce", text="hello") == "auth/episode"
            assert (await lab.ask("watch", episode=play.episode)).ok
            assert (await lab.ask("pause", episode=play.episode)).ok

    run(main())


def test_without_a_good_token_nothing_is_done(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            for bad, code in (
                ("", "message/missing-field"),
                ("nonsense", "auth/invalid"),
                (role_token(server, seconds=-1), "auth/expired"),
            ):
                lab.token = bad
                assert await lab.refused("open") == code
            assert not server.lobby.rooms

    run(main())


@pytest.mark.parametrize(
    ("payload", "code", "ref"),
    [
        (b"", "message/malformed", ""),
        (b"\xff", "message/malformed", ""),
        (b"[]", "message/malformed", ""),
        (b'{"ref": "a", "ref": "b"}', "message/malformed", ""),
        (b'{"ref": "a", "type": "zap"}', "message/unknown-type", "a"),
        (b'{"ref": "a", "type": "\\ud800"}', "message/malformed", ""),
        (b'{"ref": "a\\n", "type": "list", "token": "t"}', "message/invalid-field", ""),
        (b'{"ref": 1, "type": "list", "token": "t"}', "message/invalid-field", ""),
        (b'{"ref": "a", "type": "list", "token": "t", "x": 1}', "message/unknown-field", "a"),
        (b'{"ref": "a", "type": "open", "token": "t", "count": 101}', "message/invalid-field", "a"),
        (b'{"a": ' + b"[" * 100_000, "message/too-large", ""),
        (b'{"a": ' + b"[" * 10_000, "message/malformed", ""),
        (b" " * 1_000_000, "message/too-large", ""),
    ],
)
def test_what_is_no_command_is_answered_by_a_code(
    tmp_path: Path, payload: bytes, code: str, ref: str
) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            answer = await Lab(server, broker).send(payload)
            assert answer.error is not None
            assert (answer.error.code, answer.ref, answer.ok) == (code, ref, False)

    run(main())


def test_a_command_that_comes_twice_is_carried_out_once(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            first = await lab.ask("open", ref="once")
            again = await lab.ask("open", ref="once")
            assert first == again
            assert len(server.lobby.rooms) == 1
            lab.token = role_token(server, subject="another")
            other = await lab.ask("open", ref="once")
            assert other.opened[0].episode != first.opened[0].episode
            assert await lab.refused("pause", ref="p", episode="x") == "episode/unknown"
            assert (await lab.ask("pause", ref="p", episode=first.opened[0].code)).ok

    run(main())


def test_codes_are_told_again_to_the_same_token_alone(tmp_path: Path) -> None:
    """One of the same subject may be for another role, or for one episode."""

    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker, Role.HOST)
            opened = await lab.ask("open", ref="once", create={"tokens": True})
            lab.token = role_token(server, Role.HOST, episode=opened.opened[0].episode)
            assert await lab.refused("open", ref="once") == "auth/episode"
            lab.token = role_token(server, Role.PLAYER)
            answer = await lab.ask("open", ref="once")
            assert answer.error is not None
            assert (answer.error.code, answer.opened) == ("auth/role", [])

    run(main())


def test_a_command_comes_again_while_the_first_is_carried_out(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, _):
            topics = Topics("lab")
            commands = module.Commands(
                server, Watches(server.lobby.rooms.values), topics, asyncio.get_running_loop().time
            )
            command = {"type": "open", "count": 20, "ref": "a", "token": role_token(server)}
            received = Received(json.dumps(command).encode())
            first, again = await asyncio.gather(*(commands.answer(received) for _ in range(2)))
            assert first == again
            assert len(server.lobby.rooms) == 20

    run(main())


def test_a_flood_of_commands_does_not_drive_out_what_is_told_of_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox, "MAX_MESSAGES", 300)

    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            await asyncio.sleep(1)
            broker.stalled = True
            async with connect(server.url, name="host") as host:
                await host.create("synchronous/01")
                for _ in range(3 * outbox.MAX_MESSAGES):
                    broker.command(b"{}")
                await asyncio.sleep(120)
                broker.stalled = False
                await asyncio.sleep(120)
            assert [each["event"] for each in broker.on("life")] == ["opened"]
            assert server.metrics.mqtt_dropped_messages == 0

    run(main())


def test_a_retained_command_is_not_carried_out(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            stale = {"type": "open", "ref": "a", "token": lab.token}
            broker.command(stale, retained=True)
            await asyncio.sleep(1)
            assert not server.lobby.rooms
            assert not broker.on("answers")

    run(main())


def test_an_answer_goes_where_mqtt_5_says_with_the_correlation(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            command = {"type": "list", "ref": "a", "token": lab.token}
            broker.command(command, response_topic=f"{ANSWERS}/me", correlation=b"\x01")
            broker.command({**command, "ref": "b"}, response_topic="elsewhere", correlation=b"\x02")
            await asyncio.sleep(1)
            found = [e for e in broker.published if "/answers" in e.topic]
            assert [(e.topic, e.content["ref"], e.correlation) for e in found] == [
                (f"{ANSWERS}/me", "a", b"\x01"),
                (ANSWERS, "b", b"\x02"),
            ]

    run(main())


def test_too_many_commands_are_refused(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path) as (server, broker):
            lab = Lab(server, broker)
            for number in range(100):
                broker.command({"type": "unwatch", "ref": str(number), "token": lab.token})
            await asyncio.sleep(1)
            answers = [Answer.model_validate(each) for each in broker.on("answers")]
            assert len(answers) == 100
            codes = [each.error.code for each in answers if each.error is not None]
            assert set(codes) == {"rate/limited"}
            assert 40 <= len(codes) <= 50

    run(main())


def test_what_was_opened_before_a_limit_is_answered_with_it(tmp_path: Path) -> None:
    async def main() -> None:
        async with told(tmp_path, max_episodes_per_owner=2) as (server, broker):
            answer = await Lab(server, broker).ask("open", count=5)
            assert len(answer.opened) == 2
            assert answer.error is not None
            assert answer.error.code == "rate/episodes"

    run(main())


@pytest.mark.parametrize("ends", ["expired", "revoked"])
def test_a_watch_ends_with_its_token(tmp_path: Path, ends: str) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        began = time.time() - loop.time()
        clock = {"wall": lambda: began + loop.time()}
        async with told(tmp_path, **clock) as (server, broker), table(server) as play:
            lab = Lab(server, broker)
            lab.token = role_token(server, seconds=20 if ends == "expired" else 3600)
            assert (await lab.ask("watch")).ok
            await play.until(lambda game: game.step >= 5)
            assert broker.on("steps")
            if ends == "revoked":
                grant = server.tokens.check_role(lab.token)
                path = server.settings.state_folder / REVOKED_FILE
                revoke(path, [grant.token_id], grant.expires, 0.0)
            await asyncio.sleep(25)
            before = len(broker.on("steps"))
            await asyncio.sleep(10)
            assert len(broker.on("steps")) == before

    run(main())
