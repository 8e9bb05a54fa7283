"""Commands: permissions, replies, repetition and limits."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robotouille.protocol.messages import Create
from robotouille_client import Announced, connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.auth.revocation import REVOKED_FILE, revoke
from robotouille_server.mqtt.limits import LARGE_BYTES
from robotouille_server.mqtt.messages import CommandReply
from tests.support.brokers import Lab, role_token, serving_with_broker
from tests.support.operator import table
from tests.support.virtual_time import virtual

ANSWERS = "robotouille/v1/lab/answers"


def virtual_clock() -> Callable[[], float]:
    """Return a wall clock that follows the loop's virtual time."""
    loop = asyncio.get_running_loop()
    began = time.time() - loop.time()
    return lambda: began + loop.time()


def audit(server: Server) -> list[dict[str, Any]]:
    return [json.loads(line) for line in server.audit.path.read_text().splitlines()]


@virtual
async def test_open_list_and_close(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
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


@virtual
async def test_announce_pause_and_resume(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker), table(server) as play:
        lab = Lab(server, broker)
        assert (await lab.ask("announce", text="o\u200bne\u202e")).ok
        assert (await play.wait_for(Announced)).text == "one"
        assert (await lab.ask("announce", text="two", episode=play.episode)).ok
        assert (await play.wait_for(Announced)).text == "two"
        assert (await lab.ask("pause", episode=play.code)).ok
        await play.until(lambda game: game.phase == "paused")
        assert (await lab.ask("resume", episode=play.episode)).ok
        await play.until(lambda game: game.phase == "running")
        assert await lab.refused("pause", episode="none") == "episode/unknown"
        assert await lab.refused("announce", text="\u200b") == "message/invalid-field"
        lines = audit(server)
        done = ["announce to all", "announce", "pause", "resume"]
        assert [line["what"] for line in lines] == [*done, "mqtt pause"]
        assert lines[-1]["result"] == "episode/unknown"


@pytest.mark.parametrize(
    ("role", "refused"),
    [
        (Role.OPERATOR, set()),
        (Role.HOST, {"announce", "pause", "resume"}),
        (Role.PLAYER, {"announce", "pause", "resume", "watch", "list", "open", "close"}),
    ],
)
@virtual
async def test_permissions_of_each_role(tmp_path: Path, role: Role, refused: set[str]) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
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


@virtual
async def test_hosts_watch_and_close_only_their_own_episodes(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker), table(server) as play:
        lab = Lab(server, broker, Role.HOST)
        assert await lab.refused("watch", episode=play.episode) == "auth/episode"
        assert await lab.refused("close", episode=play.episode) == "auth/episode"
        assert (await lab.ask("watch")).ok, "of all that are its own"
        await play.until(lambda game: game.step >= 20)
        assert not broker.on("steps")
        assert not (await lab.ask("list")).episodes[0].labels


@virtual
async def test_token_for_one_episode_works_for_no_other(tmp_path: Path) -> None:
    async with (
        serving_with_broker(tmp_path, wall=virtual_clock()) as (server, broker),
        table(server) as play,
    ):
        lab = Lab(server, broker)
        lab.token = role_token(server, episode=play.episode)
        other = server.lobby.create(Create())
        assert await lab.refused("open") == "auth/episode"
        assert await lab.refused("watch") == "auth/episode"
        assert await lab.refused("watch", episode=other.id) == "auth/episode"
        assert await lab.refused("pause", episode=other.id) == "auth/episode"
        assert await lab.refused("announce", text="hello") == "auth/episode"
        assert (await lab.ask("watch", episode=play.episode)).ok
        assert (await lab.ask("pause", episode=play.episode)).ok


@virtual
async def test_invalid_tokens_are_refused(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        for bad, code in (
            ("", "message/missing-field"),
            ("nonsense", "auth/invalid"),
            (role_token(server, seconds=-1), "auth/expired"),
        ):
            lab.token = bad
            assert await lab.refused("open") == code
        assert not server.lobby.rooms


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
@virtual
async def test_invalid_commands_are_refused(
    tmp_path: Path, payload: bytes, code: str, ref: str
) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        answer = await Lab(server, broker).send(payload)
        assert answer.error is not None
        assert (answer.error.code, answer.ref, answer.ok) == (code, ref, False)


@virtual
async def test_repeated_command_is_executed_once(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
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


@virtual
async def test_repeated_reply_goes_only_to_the_same_token(tmp_path: Path) -> None:
    # Other tokens of the same subject may have another role, or be for one episode.

    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker, Role.HOST)
        opened = await lab.ask("open", ref="once", create={"tokens": True})
        lab.token = role_token(server, Role.HOST, episode=opened.opened[0].episode)
        assert await lab.refused("open", ref="once") == "auth/episode"
        lab.token = role_token(server, Role.PLAYER)
        answer = await lab.ask("open", ref="once")
        assert answer.error is not None
        assert (answer.error.code, answer.opened) == ("auth/role", [])


@virtual
async def test_command_repeated_at_once_is_executed_once(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        command = {"type": "open", "count": 20, "ref": "a", "token": role_token(server)}
        for _ in range(2):
            broker.command(command)
        await asyncio.sleep(1)
        first, again = broker.on("answers")
        assert first == again
        assert len(server.lobby.rooms) == 20


@virtual
async def test_retained_commands_are_ignored(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        stale = {"type": "open", "ref": "a", "token": lab.token}
        broker.command(stale, retain=True)
        await asyncio.sleep(1)
        assert not server.lobby.rooms
        assert not broker.on("answers")


@virtual
async def test_reply_uses_the_response_topic_and_correlation_data(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        command = {"type": "list", "ref": "a", "token": lab.token}
        broker.command(command, ResponseTopic=f"{ANSWERS}/me", CorrelationData=b"\x01")
        broker.command({**command, "ref": "b"}, ResponseTopic="elsewhere", CorrelationData=b"\x02")
        await asyncio.sleep(1)
        found = [e for e in broker.published if "/answers" in e.topic]
        assert [(e.topic, e.content["ref"], e.correlation) for e in found] == [
            (f"{ANSWERS}/me", "a", b"\x01"),
            (ANSWERS, "b", b"\x02"),
        ]


@virtual
async def test_commands_over_the_rate_limit_are_refused(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        for number in range(100):
            broker.command({"type": "unwatch", "ref": str(number), "token": lab.token})
        await asyncio.sleep(1)
        answers = [CommandReply.model_validate(each) for each in broker.on("answers")]
        assert len(answers) == 100
        codes = [each.error.code for each in answers if each.error is not None]
        assert set(codes) == {"rate/limited"}
        assert 40 <= len(codes) <= 50


def refused_command(server: Server, number: int, why: str) -> dict[str, Any]:
    """Return a command that the server refuses, for one of the reasons below."""
    token = {"token": "nonsense", "role": role_token(server, Role.PLAYER)}.get(why, "")
    command = {"type": "unwatch", "ref": f"x{number}", "token": token or role_token(server)}
    return {**command, "x": 1} if why == "field" else command


@pytest.mark.parametrize("why", ["token", "role", "field"])
@virtual
async def test_refused_commands_do_not_use_up_the_limit_of_others(tmp_path: Path, why: str) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        refused = refused_command(server, 0, why)
        for _ in range(300):
            broker.command(refused)
        for number in range(50):
            broker.command({"type": "unwatch", "ref": str(number), "token": lab.token})
        await asyncio.sleep(1)
        done = [each["ref"] for each in broker.on("answers") if each["ok"]]
        assert done == [str(number) for number in range(50)]


@pytest.mark.parametrize(
    ("why", "code"),
    [("token", "auth/invalid"), ("role", "auth/role"), ("field", "message/unknown-field")],
)
@virtual
async def test_refusals_over_the_limit_repeat_the_ref(tmp_path: Path, why: str, code: str) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        for number in range(100):
            broker.command(refused_command(server, number, why))
        await asyncio.sleep(1)
        answers = [CommandReply.model_validate(each) for each in broker.on("answers")]
        assert [each.ref for each in answers] == [f"x{number}" for number in range(100)]
        codes = [each.error.code for each in answers if each.error is not None]
        assert codes == [code] * 50 + ["rate/limited"] * 50
        assert len(audit(server) if why == "role" else []) == (50 if why == "role" else 0)


@virtual
async def test_accepted_command_over_the_limit_repeats_the_ref(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        for number in range(60):
            broker.command({"type": "unwatch", "ref": str(number), "token": lab.token})
        await asyncio.sleep(1)
        answers = broker.on("answers")
        assert [(each["ref"], each["subject"]) for each in answers] == [
            (str(number), "lab") for number in range(60)
        ]
        assert not answers[-1]["ok"]


@virtual
async def test_flood_of_refused_commands_is_not_answered(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path) as (server, broker):
        refused = refused_command(server, 0, "token")
        for _ in range(1000):
            broker.command(refused)
        await asyncio.sleep(1)
        assert len(broker.on("answers")) == 100
        await asyncio.sleep(10)
        lab = Lab(server, broker)
        lab.token = "nonsense"
        assert await lab.refused("list") == "auth/invalid"


@virtual
async def test_large_commands_are_read_during_a_flood_only_with_a_valid_token(
    tmp_path: Path,
) -> None:
    # Reading 64 KiB takes a hundred times as long as checking a token.
    async with serving_with_broker(tmp_path) as (server, broker):
        lab = Lab(server, broker)
        phrases = [f"{number:02d} {'é' * 50}" for number in range(32)]
        create = {"chat": "phrases", "phrases": phrases}
        command = {"type": "open", "ref": "a", "token": lab.token, "create": create}
        assert len(json.dumps(command)) > LARGE_BYTES
        refused = {**command, "ref": "b", "token": role_token(server, Role.PLAYER)}
        for _ in range(60):
            broker.command({"ref": "flood"})
        broker.command(refused)
        broker.command(command)
        await asyncio.sleep(1)
        unread, opened = map(CommandReply.model_validate, broker.on("answers")[60:])
        assert (unread.error and unread.error.code, unread.ref) == ("rate/limited", "")
        assert (opened.ok, opened.ref) == (True, "a")
        await asyncio.sleep(10)
        answer = await lab.send(refused)
        assert (answer.error and answer.error.code, answer.ref) == ("auth/role", "b")


@virtual
async def test_replies_name_the_subject_of_the_token(tmp_path: Path) -> None:
    # The sender of a command chooses the answer topic, the `ref` and the correlation data.
    async with serving_with_broker(tmp_path) as (server, broker):
        ours = {"ResponseTopic": f"{ANSWERS}/lab", "CorrelationData": b"1"}
        for subject, token in (
            ("lab", role_token(server)),
            ("other", role_token(server, Role.HOST, "other")),
            ("other", role_token(server, Role.PLAYER, "other")),
            ("", "nonsense"),
        ):
            command = {"type": "open", "ref": "a", "token": token}
            broker.command(command, **ours)
            await asyncio.sleep(1)
            answer = CommandReply.model_validate(broker.on("answers/lab")[-1])
            assert (answer.ref, answer.subject) == ("a", subject)


@virtual
async def test_reply_lists_the_episodes_opened_before_a_limit(tmp_path: Path) -> None:
    async with serving_with_broker(tmp_path, max_episodes_per_owner=2) as (server, broker):
        answer = await Lab(server, broker).ask("open", count=5)
        assert len(answer.opened) == 2
        assert answer.error is not None
        assert answer.error.code == "rate/episodes"


@pytest.mark.parametrize("ends", ["expired", "revoked"])
@virtual
async def test_watch_ends_with_its_token(tmp_path: Path, ends: str) -> None:
    async with (
        serving_with_broker(tmp_path, wall=virtual_clock()) as (server, broker),
        table(server) as play,
    ):
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
