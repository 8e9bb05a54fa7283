"""Conversations: every message gets a precise answer, and other clients notice nothing."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MAX_CLIENT_BYTES, MSGPACK
from tests.support.servers import raw, serving
from tests.support.thorough import thorough
from tests.support.virtual_time import run, virtual

# Message, code of the answer, and the field that the answer names.
WRONG: list[tuple[Any, str, str]] = [
    ([], "message/malformed", ""),
    ("hello", "message/malformed", ""),
    (17, "message/malformed", ""),
    ({}, "message/unknown-type", "type"),
    ({"type": "fly"}, "message/unknown-type", "type"),
    ({"type": None}, "message/unknown-type", "type"),
    ({"type": ["act"]}, "message/unknown-type", "type"),
    ({"type": "hello", "protocol": 1, "name": "again"}, "protocol/hello", "type"),
    ({"type": "list", "ref": -1}, "message/invalid-field", "ref"),
    ({"type": "list", "ref": "1"}, "message/invalid-field", "ref"),
    ({"type": "list", "more": 1}, "message/unknown-field", "more"),
    ({"type": "create", "task": "no/such"}, "task/unknown", "task"),
    ({"type": "create", "task": "/etc/passwd.json"}, "task/unknown", "task"),
    ({"type": "create", "task": "../../secret"}, "task/unknown", "task"),
    ({"type": "create", "task": "synchronous/01", "seats": 9}, "task/invalid", "seats"),
    ({"type": "create", "clock": "sundial"}, "message/invalid-field", "clock"),
    ({"type": "create", "step_rate": 0}, "message/invalid-field", "step_rate"),
    ({"type": "create", "step_rate": 1e9}, "message/invalid-field", "step_rate"),
    ({"type": "create", "max_steps": -5}, "message/invalid-field", "max_steps"),
    ({"type": "create", "max_steps": "10"}, "message/invalid-field", "max_steps"),
    ({"type": "create", "max_steps": True}, "message/invalid-field", "max_steps"),
    ({"type": "join"}, "message/missing-field", "episode"),
    ({"type": "join", "episode": "ZZZZZ"}, "episode/unknown", "episode"),
    ({"type": "join", "episode": ""}, "message/invalid-field", "episode"),
    ({"type": "join", "episode": "x" * 65}, "message/invalid-field", "episode"),
    ({"type": "join", "episode": 5}, "message/invalid-field", "episode"),
    ({"type": "join", "episode": "A", "role": "god"}, "message/invalid-field", "role"),
    ({"type": "join", "episode": "A", "known": ["x"] * 65}, "message/invalid-field", "known"),
    ({"type": "leave"}, "episode/none", "type"),
    ({"type": "resync"}, "episode/none", "type"),
    ({"type": "ready"}, "episode/none", "type"),
    ({"type": "say", "text": "hello"}, "episode/none", "type"),
    ({"type": "say"}, "message/missing-field", "text"),
    ({"type": "say", "text": ""}, "message/invalid-field", "text"),
    ({"type": "say", "text": "x" * 501}, "message/invalid-field", "text"),
    ({"type": "act", "action": None}, "message/missing-field", "seq"),
    ({"type": "act", "seq": 1}, "message/missing-field", "action"),
    ({"type": "act", "seq": 0, "action": None}, "message/invalid-field", "seq"),
    ({"type": "act", "seq": 2**60, "action": None}, "message/invalid-field", "seq"),
    (
        {"type": "act", "seq": 1, "action": None, "think_ms": -1},
        "message/invalid-field",
        "think_ms",
    ),
    ({"type": "act", "seq": 1, "action": {"name": "x"} | {"a": 1}}, "message/", "action"),
    ({"type": "welcome"}, "message/unknown-type", "type"),
]


@pytest.mark.parametrize("text", [True, False], ids=["json", "msgpack"])
@virtual
async def test_invalid_message_gets_its_code_and_field(tmp_path: Path, text: bool) -> None:
    async with serving(tmp_path, messages_per_second=10_000) as server:
        async with raw(server, text=text) as client:
            for message, code, field in WRONG:
                answer = await client.ask(message)
                assert answer["type"] == "error", message
                assert answer["code"].startswith(code), (message, answer)
                assert answer.get("field", "").startswith(field), (message, answer)
                assert answer["message"]
            # The connection lives on.
            assert (await client.ask({"type": "list", "ref": 3}, "episodes"))["ref"] == 3


def nested(depth: int) -> Any:
    value: Any = 1
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("payload", "code"),
    [
        ("{", "message/malformed"),
        ("", "message/malformed"),
        ('{"type": "list", "type": "list"}', "message/malformed"),
        ('{"type": "say", "text": NaN}', "message/malformed"),
        ("[" * 50_000, "message/malformed"),
        (json.dumps({"type": "list", "ref": nested(30)}), "message/"),
        ('{"type": "say", "text": "' + "x" * 60_000 + '"}', "message/invalid-field"),
        ('"' + '\\"' * 30_000, "message/malformed"),
        (b"\x80", "message/frame"),
        (b"", "message/frame"),
    ],
    ids=range(10),
)
def test_malformed_json(tmp_path: Path, payload: str | bytes, code: str) -> None:
    check_payload(tmp_path, payload, code, text=True)


@pytest.mark.parametrize(
    ("payload", "code"),
    [
        ("{}", "message/frame"),
        (b"", "message/malformed"),
        (b"\xc1", "message/malformed"),
        (b"\xdd\xff\xff\xff\xff", "message/malformed"),
        (b"\xc7\x04\x01abcd", "message/malformed"),
        (b"\x91" * 50_000, "message/malformed"),
        (b"\x81\xa4type\xa4li", "message/malformed"),
        (msgpack.packb({"type": "list", "ref": nested(30)}), "message/"),
        (msgpack.packb({1: 2}), "message/"),
        (msgpack.packb({"type": "list"}) + b"\x00", "message/malformed"),
        (b"\x81\xa4type\xa2\xff\xfe", "message/malformed"),
    ],
    ids=range(11),
)
def test_malformed_messagepack(tmp_path: Path, payload: str | bytes, code: str) -> None:
    check_payload(tmp_path, payload, code, text=False)


def check_payload(folder: Path, payload: str | bytes, code: str, *, text: bool) -> None:
    async def main() -> None:
        async with serving(folder) as server, raw(server, text=text) as client:
            await client.socket.send(payload)
            answer = await client.expect("error")
            assert answer["code"].startswith(code), answer
            assert (await client.ask({"type": "list"}, "episodes"))["type"] == "episodes"

    run(main())


@virtual
async def test_error_has_the_reference_of_the_request(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as client:
        answer = await client.ask({"type": "create", "ref": 7, "seats": 0})
        assert (answer["code"], answer["ref"]) == ("message/invalid-field", 7)


@virtual
async def test_huge_message_closes_only_its_own_connection(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as good, raw(server) as bad:
        await bad.socket.send("x" * (MAX_CLIENT_BYTES + 1))
        assert (await bad.expect("error"))["code"] == "message/too-large"
        await bad.socket.send("x" * (2 * MAX_CLIENT_BYTES + 1))
        await bad.socket.wait_closed()
        assert bad.socket.close_code == 1009
        assert (await good.ask({"type": "list"}, "episodes"))["type"] == "episodes"


@virtual
async def test_unknown_version_and_missing_hello_are_refused(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, hello=False) as client:
        answer = await client.ask({"type": "list"})
        assert answer["code"] == "protocol/hello"
        answer = await client.ask({"type": "hello", "protocol": 99, "name": "x"})
        assert (answer["code"], answer["field"]) == ("protocol/version", "protocol")
        assert "the server is older and must be updated" in answer["message"]
        answer = await client.ask({"type": "hello", "protocol": 0, "name": "x"})
        assert "your program is older" in answer["message"]
        answer = await client.ask({"type": "hello", "protocol": 1, "name": "x", "resume": "no"})
        assert (answer["code"], answer["field"]) == ("auth/invalid", "resume")
        welcome = await client.ask({"type": "hello", "protocol": 1, "name": "x"}, "welcome")
        assert welcome["protocol"] == 1


@virtual
async def test_rate_limit_refuses_without_closing(tmp_path: Path) -> None:
    async with serving(tmp_path, messages_per_second=10) as server, raw(server) as client:
        for _ in range(40):
            await client.send({"type": "list"})
        kinds = [await client.expect("episodes", "error") for _ in range(40)]
        codes = [m.get("code") for m in kinds]
        assert codes.count("rate/limited") >= 15
        await asyncio.sleep(3)
        assert (await client.ask({"type": "list"}, "episodes"))["type"] == "episodes"


@virtual
async def test_silent_client_is_dropped(tmp_path: Path) -> None:
    async with serving(tmp_path, hello_seconds=10) as server:
        async with raw(server, hello=False) as silent:
            begun = asyncio.get_running_loop().time()
            assert (await silent.receive())["type"] == "bye"
            await silent.socket.wait_closed()
            assert 9 < asyncio.get_running_loop().time() - begun < 15
        page = server.metrics.page().decode()
        assert 'robotouille_dropped_connections_total{reason="silent"} 1.0' in page


@pytest.mark.slow
@virtual
async def test_client_that_does_not_read_is_dropped(
    tmp_path: Path,
) -> None:
    options = {"step_rate": 60, "stall_seconds": 5, "max_steps": 5000}
    async with serving(tmp_path, **options) as server:
        async with raw(server) as ada, raw(server) as deaf:
            created = await ada.ask(
                {"type": "create", "task": "multi_agent/10", "clock": "realtime"}, "created"
            )
            join = {"type": "join", "episode": created["code"]}
            await deaf.ask({**join, "view": "both"}, "joined")
            deaf.socket.transport.pause_reading()
            room = server.lobby.find(created["code"])
            (session,) = room.members
            await ada.ask(join, "joined")
            peak = 0
            last = 0
            while session.peer is not None and last < 4500:
                last = (await ada.expect("delta"))["step"]
                if session.peer is not None:
                    peak = max(peak, session.peer.unsent)
            assert session.peer is None, "the deaf client was never dropped"
            assert peak < 1_500_000
            assert (await ada.expect("delta"))["step"] == last + 1
        page = server.metrics.page().decode()
        assert 'robotouille_dropped_connections_total{reason="stalled"} 1.0' in page


scalars = (
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=20)
)
values = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)
FIELDS = sorted({name for model in messages.CLIENT_MESSAGES for name in model.model_fields})
TYPES = [model.model_fields["type"].default for model in messages.CLIENT_MESSAGES]
anything = st.one_of(
    values,
    st.builds(
        lambda kind, fields: {"type": kind, **fields},
        st.sampled_from(TYPES),
        st.dictionaries(st.sampled_from(FIELDS), values, max_size=5),
    ),
)


@thorough(40)
@given(anything, st.sampled_from([JSON, MSGPACK]))
def test_decoder_returns_a_message_or_raises_protocol_error(message: Any, codec: Any) -> None:
    try:
        payload = codec.pack(message)
    except (OverflowError, UnicodeEncodeError, ValueError):
        return
    try:
        decoded = codec.decode_client(payload)
        assert decoded.type in TYPES
    except ProtocolError as error:
        assert error.code.startswith("message/")


@thorough(6)
@given(st.lists(anything, min_size=5, max_size=30))
@virtual
async def test_hostile_player_disturbs_nobody(tmp_path: Path, hostile: list[Any]) -> None:
    async with serving(tmp_path, messages_per_second=10_000, max_steps=500) as server:
        async with raw(server) as ada, raw(server) as bad, raw(server) as other:
            created = await ada.ask(
                {"type": "create", "task": "multi_agent/01", "clock": "realtime"}, "created"
            )
            for client in (ada, bad):
                await client.ask({"type": "join", "episode": created["code"]}, "joined")
            for message in hostile:
                if isinstance(message, dict) and message.get("type") == "leave":
                    continue
                try:
                    await bad.send(message)
                except (ValueError, OverflowError, UnicodeEncodeError):
                    continue
            await bad.socket.send(b"\xc1")
            await bad.expect("error")
            before = (await ada.expect("delta"))["step"]
            assert (await ada.expect("delta"))["step"] == before + 1
            assert (await other.ask({"type": "list"}, "episodes"))["episodes"]
    from robotouille.replay.recording import read_recording

    for path in tmp_path.glob("*.rbt"):
        assert read_recording(path).verify().ok
        path.unlink()
