"""WebSocket behaviour towards Node's `ws` and a plain socket."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille.protocol.codec import JSON, MAX_CLIENT_BYTES, MSGPACK
from tests.conformance.node import run_node
from tests.support.server_process import ServerProcess

pytestmark = pytest.mark.process

BROKEN = 1002
NOT_TEXT = 1007
TOO_BIG = 1009


@pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=["json", "msgpack"])
def test_message_may_be_split_anywhere(server: ServerProcess, codec: Any) -> None:
    result = run_node("fragments", url=server.url, subprotocol=codec.name)
    assert result["welcome"]["type"] == "welcome"
    assert result["welcome"]["ref"] == 7
    assert result["pongs"] == [f"ping {i}" for i in range(0, result["frames"], 10)]


def test_close_code_is_echoed(server: ServerProcess) -> None:
    codes = [1000, 1001, 3000, 4000, 4999]
    assert run_node("closings", url=server.url, codes=codes) == codes


def test_wrong_frame_type_is_an_error_but_not_fatal(server: ServerProcess) -> None:
    answers = run_node("mixups", url=server.url)
    assert answers == {codec.name: ["message/frame", "welcome"] for codec in (JSON, MSGPACK)}


def test_first_known_subprotocol_is_chosen(server: ServerProcess) -> None:
    offers = [
        [JSON.name, MSGPACK.name],
        [MSGPACK.name, JSON.name],
        ["chat", MSGPACK.name],
        [],
        ["chat"],
    ]
    chosen = run_node("offers", url=server.url, offers=offers)
    assert chosen[:3] == [
        [JSON.name, "text", "welcome"],
        [MSGPACK.name, "binary", "welcome"],
        [MSGPACK.name, "binary", "welcome"],
    ]
    assert chosen[3] == ["", "text", "welcome"], "no subprotocol is JSON"
    assert chosen[4] == "Server sent no subprotocol", "an unknown one is not chosen"


def test_large_message_is_refused_and_a_huge_one_closes(server: ServerProcess) -> None:
    result = run_node(
        "oversized", url=server.url, large=MAX_CLIENT_BYTES + 1, huge=2 * MAX_CLIENT_BYTES + 1
    )
    assert result == {"error": "message/too-large", "then": "episodes", "code": TOO_BIG}


def test_compression_is_not_negotiated(server: ServerProcess) -> None:
    assert run_node("compression", url=server.url) == {"extensions": "", "type": "welcome"}


def test_invalid_frames_fail_the_connection(server: ServerProcess) -> None:
    results = run_node("violations", url=server.url)
    expected = {name: {BROKEN} for name in results}
    expected["text that is not UTF-8"] = {NOT_TEXT}
    expected["a length of 2^63 bytes"] = {BROKEN, TOO_BIG}
    expected["a length of 2^40 bytes"] = {TOO_BIG}
    assert len(results) >= 15
    for name, result in results.items():
        assert result["accepted"], name
        assert result["unmasked"], name
        assert result["code"] in expected[name], (name, result)
