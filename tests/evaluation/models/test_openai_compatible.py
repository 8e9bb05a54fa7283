"""Models behind an endpoint on a real socket, with good and bad responses and recorded pauses."""

from __future__ import annotations

import importlib.util
import json
import sys
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import anyio
import pytest

from robotouille.errors import MissingExtraError, WrongArgumentError
from robotouille_evaluation.models import (
    Completion,
    Endpoint,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    OpenAICompatibleModel,
    Prices,
    Usage,
    openai_compatible,
)
from robotouille_evaluation.models.openai_compatible import MAX_ERROR_BYTES, key_from_environment
from robotouille_evaluation.models.responses import MAX_ANSWER_BYTES
from tests.support import openai_server
from tests.support.openai_server import (
    HANG_UP,
    SILENCE,
    Raw,
    Reply,
    ScriptedEndpoint,
    answer,
    error,
    page,
    stream,
    tool_call,
)
from tests.support.samples import quick_sample

if importlib.util.find_spec("openai") is None:  # Not imported: that takes a second.
    pytest.skip("needs openai", allow_module_level=True)

KEY = "sk-test-0123456789abcdef"
REQUEST = ModelRequest(
    (Message("system", "You cook."), Message("user", "What now?")), parameters={"seed": 7}
)
KINDS = ModelErrorKind


@pytest.fixture(autouse=True)
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that the SDK and the model wanted to wait."""
    found: list[float] = []

    async def record(seconds: float) -> None:
        found.append(seconds)

    monkeypatch.setattr(anyio, "sleep", record)
    return found


@asynccontextmanager
async def asking(
    *script: Reply, key: str | None = KEY, **options: Any
) -> AsyncIterator[tuple[OpenAICompatibleModel, ScriptedEndpoint]]:
    async with openai_server.endpoint(*script) as server:
        async with OpenAICompatibleModel(Endpoint("scripted", server.url, **options), key=key) as m:
            yield m, server


async def failure(*script: Reply, **options: Any) -> tuple[ModelError, int]:
    """Return the error that a script ends in, and the number of requests."""
    async with asking(*script, **options) as (model, server):
        with pytest.raises(ModelError) as caught:
            await model.complete(REQUEST)
        assert KEY not in str(caught.value) and KEY not in repr(caught.value)
        return caught.value, len(server.received)


async def success(*script: Reply, **options: Any) -> Completion:
    async with asking(*script, **options) as (model, _):
        return await model.complete(REQUEST)


async def test_request_and_answer() -> None:
    options = {"parameters": {"temperature": 0.7, "seed": 1, "top_k": 5}, "prices": Prices(2, 10)}
    async with asking(answer("Action: Wait"), **options) as (model, server):
        completion = await model.complete(REQUEST)
    assert completion.text == "Action: Wait" and completion.finish_reason == "stop"
    assert completion.usage == Usage(100, 20, pytest.approx(0.0004))
    assert completion.seconds > 0 and completion.attempts == 1 and model.name == "scripted"
    (received,) = server.received
    assert received.path == "/v1/chat/completions"
    assert received.headers["authorization"] == f"Bearer {KEY}"
    assert received.body == {
        "model": "scripted",
        "messages": [
            {"role": "system", "content": "You cook."},
            {"role": "user", "content": "What now?"},
        ],
        "temperature": 0.7,
        "seed": 7,
        "top_k": 5,
    }


async def test_openai_key_is_not_sent_over_http(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTOUILLE_LLM_API_KEY", raising=False)
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    async with asking(answer("yes"), key=None) as (model, server):
        await model.complete(REQUEST)
    assert "authorization" not in server.received[0].headers
    monkeypatch.setenv("ROBOTOUILLE_LLM_API_KEY", "ours")
    async with asking(answer("yes"), key=None) as (model, server):
        await model.complete(REQUEST)
    assert server.received[0].headers["authorization"] == "Bearer ours"


def test_keys_from_the_environment() -> None:
    both = {"ROBOTOUILLE_LLM_API_KEY": "ours", "OPENAI_API_KEY": "theirs"}
    assert key_from_environment(both, "https://example.org/v1") == "ours"
    theirs = {"OPENAI_API_KEY": "theirs", "ROBOTOUILLE_LLM_API_KEY": " "}
    assert key_from_environment(theirs, "https://example.org/v1") == "theirs"
    assert key_from_environment(theirs, "http://127.0.0.1:8000/v1") is None
    assert key_from_environment({}, "https://example.org/v1") is None


def test_openai_needs_a_key(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROBOTOUILLE_LLM_API_KEY", "OPENAI_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ModelError, match="ROBOTOUILLE_LLM_API_KEY") as caught:
        OpenAICompatibleModel(Endpoint("gpt"))
    assert caught.value.kind is KINDS.NO_KEY
    assert "api.openai.com" in str(caught.value) and "--base-url" in str(caught.value)


def test_missing_sdk_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    class WithoutAiohttp:
        def __init__(self, **_: object) -> None:
            raise RuntimeError("install the extra aiohttp")

    monkeypatch.setattr("openai.DefaultAioHttpClient", WithoutAiohttp)
    with pytest.raises(MissingExtraError, match=r"robotouille\[llm\]"):
        OpenAICompatibleModel(Endpoint("m"), key=KEY)
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[llm\]"):
        OpenAICompatibleModel(Endpoint("m"), key=KEY)


async def test_status_401_without_a_key_asks_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTOUILLE_LLM_API_KEY", raising=False)
    caught, requests = await failure(error(401, "who are you"), key=None)
    assert caught.kind is KINDS.NO_KEY and "who are you" in str(caught) and requests == 1


@pytest.mark.parametrize(
    ("reply", "kind", "again"),
    [
        (error(400, "no such parameter"), KINDS.REFUSED, False),
        (error(403), KINDS.REFUSED, False),
        (error(404, "the model does not exist"), KINDS.REFUSED, False),
        (page(404), KINDS.ENDPOINT, False),
        (page(200), KINDS.ENDPOINT, True),
        (Reply(b"{}", content_type=None), KINDS.ENDPOINT, True),
        (Reply(b"{}"), KINDS.ENDPOINT, True),
        (Reply(b'{"choices": [{"mess'), KINDS.ENDPOINT, True),
        (Reply(b"[" * 100_000), KINDS.ENDPOINT, True),
        (Reply(b'\xff\xfe{"choices"'), KINDS.ENDPOINT, True),
        (Reply(b'{"error": {"message": "overloaded", "code": 502}}'), KINDS.ENDPOINT, True),
        (Reply(b'{"choices": [', missing=500), KINDS.ENDPOINT, True),
        (Reply(b"{}", headers={"content-encoding": "gzip"}), KINDS.ENDPOINT, True),
        (Reply(b"{}", headers={"x-long": "x" * 100_000}), KINDS.ENDPOINT, False),
        (Raw(b"SSH-2.0-OpenSSH_9.2\r\n\r\n"), KINDS.ENDPOINT, False),
        (HANG_UP, KINDS.ENDPOINT, True),
        (stream("Action: Wait"), KINDS.ENDPOINT, True),
        (error(500), KINDS.SERVER, True),
        (error(503), KINDS.SERVER, True),
        (error(408), KINDS.REFUSED, True),
        (error(429, "slow down"), KINDS.RATE_LIMITED, True),
        (error(429, retry_after="3600"), KINDS.RATE_LIMITED, False),
        (answer(""), KINDS.EMPTY, True),
        (answer(" \n"), KINDS.EMPTY, True),
        (answer(None, finish_reason="length"), KINDS.EMPTY, False),
        (answer(None, finish_reason="content_filter", refusal="No."), KINDS.EMPTY, False),
        (tool_call(), KINDS.EMPTY, True),
    ],
)  # fmt: skip
async def test_bad_responses(reply: Reply, kind: ModelErrorKind, again: bool) -> None:
    caught, requests = await failure(reply, attempts=3)
    assert caught.kind is kind
    assert requests == caught.attempts == (3 if again else 1)


@pytest.mark.parametrize(
    ("status", "said"),
    [
        (400, "This model's maximum context length is 8192 tokens."),
        (400, "request (4024 tokens) exceeds the available context size (2048 tokens)"),
        (400, "prompt is too long: 210000 tokens > 200000 maximum"),
        (413, "context_length_exceeded"),
    ],
)
async def test_too_long_conversations(status: int, said: str) -> None:
    caught, requests = await failure(error(status, said))
    assert caught.kind is KINDS.CONTEXT_OVERFLOW and requests == 1


async def test_failed_attempts_that_were_charged_are_counted() -> None:
    caught, _ = await failure(tool_call(), prices=Prices(1, 1), attempts=2)
    assert caught.usage == Usage(200, 40, pytest.approx(0.00024)) and "tool call" in str(caught)


async def test_answer_without_a_choice_is_paid_for() -> None:
    usage = {"prompt_tokens": 100, "completion_tokens": 20}
    empty = Reply(json.dumps({"choices": [], "usage": usage}).encode())
    caught, _ = await failure(empty, prices=Prices(1, 1), attempts=2)
    assert caught.usage == Usage(200, 40, pytest.approx(0.00024))
    assert "no choice" in str(caught)
    completion = await success(empty, answer("at last"), prices=Prices(1, 1))
    assert completion.usage == Usage(200, 40, pytest.approx(0.00024))


async def test_cost_without_a_report_of_tokens_is_unknown() -> None:
    bare = Reply(json.dumps({"choices": [{"message": {"content": "Wait"}}]}).encode())
    assert (await success(bare, prices=Prices(1, 1))).usage == Usage()
    half = answer("Wait", usage={"prompt_tokens": 100})  # type: ignore[arg-type]
    assert (await success(half, prices=Prices(1, 1))).usage == Usage(100)
    assert Usage(1, 1, 0.5) + Usage(1, 1) == Usage(2, 2), "a sum with an unknown cost is unknown"


@pytest.mark.parametrize("content_type", [None, "", "text/plain"])
async def test_json_of_any_content_type_is_read(content_type: str | None) -> None:
    reply = replace(answer("Wait"), content_type=content_type)
    assert (await success(reply)).text == "Wait"


async def test_retries_are_counted_with_their_usage(pauses: list[float]) -> None:
    completion = await success(error(500), HANG_UP, answer(""), answer("at last"))
    assert completion.text == "at last" and completion.attempts == 4
    assert completion.usage == Usage(200, 40)
    assert len(pauses) == 3 and all(0.3 < pause < 5 for pause in pauses)


async def test_retries_wait_as_long_as_the_endpoint_asks(pauses: list[float]) -> None:
    await success(error(429, retry_after="7"), answer("yes"))
    assert pauses == [7]


async def test_no_response_times_out() -> None:
    caught, requests = await failure(SILENCE, timeout=0.05, attempts=2)
    assert caught.kind is KINDS.TIME_OUT and requests == 2


async def test_a_response_that_stalls_times_out() -> None:
    stalled = Reply(answer("Action: Wait").body, stalls=True)
    caught, _ = await failure(stalled, timeout=0.2, attempts=1)
    assert caught.kind is KINDS.TIME_OUT


async def test_a_response_that_trickles_times_out() -> None:
    trickling = Reply(answer("Wait " * 1000).body, trickles=True)
    caught, _ = await failure(trickling, timeout=0.2, attempts=1)
    assert caught.kind is KINDS.TIME_OUT


async def test_a_head_that_trickles_times_out() -> None:
    dripping = Reply(answer("Wait").body, drips=True)
    caught, _ = await failure(dripping, timeout=0.1, attempts=1)
    assert caught.kind is KINDS.TIME_OUT


@pytest.mark.parametrize("reply", [answer("Wait", finish_reason="\ud800"), error(400, "\ud800")])
async def test_lone_surrogates_are_replaced(reply: Reply) -> None:
    async with asking(reply) as (model, _):
        try:
            found = repr(await model.complete(REQUEST))
        except ModelError as caught:
            found = str(caught)
    assert "?" in found and "ud800" not in ascii(found)


@pytest.mark.parametrize(("status", "kind"), [(200, KINDS.ENDPOINT), (400, KINDS.REFUSED)])
async def test_a_response_without_end_is_not_read(
    monkeypatch: pytest.MonkeyPatch, status: int, kind: ModelErrorKind
) -> None:
    monkeypatch.setattr(openai_compatible, "MAX_BODY_BYTES", 1000)
    monkeypatch.setattr(openai_compatible, "MAX_ERROR_BYTES", 1000)
    caught, _ = await failure(Reply(b" " * 100_000, status=status), attempts=1)
    assert caught.kind is kind


async def test_little_of_an_error_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[int] = []
    shorten = openai_compatible.error_of_status

    def recorded(status: int, body: str, *args: Any, **options: Any) -> ModelError:
        read.append(len(body))
        return shorten(status, body, *args, **options)

    monkeypatch.setattr(openai_compatible, "error_of_status", recorded)
    events = b'data: {"choices": []}\n\n' * 100_000
    caught, _ = await failure(Reply(events, 400, "text/event-stream"), attempts=1)
    assert caught.kind is KINDS.REFUSED and read == [MAX_ERROR_BYTES]


async def test_a_response_of_empty_objects_is_not_parsed() -> None:
    """Sixteen megabytes of them took 470 MiB of memory."""
    caught, _ = await failure(Reply(b"[" + b"{}," * 500_000 + b"{}]"), attempts=1)
    assert "more than 200,000 objects and lists" in str(caught)
    caught, _ = await failure(Reply(b"[" + b"{}," * 5_000_000 + b"{}]"), attempts=1)
    assert "more than 4,000,000 bytes" in str(caught)


async def test_the_header_chooses_no_slow_encoding() -> None:
    """Time to decode Punycode grows with the square of its length."""
    reply = answer("Action: Wait é")
    named = Reply(reply.body, content_type="application/json; charset=punycode")
    assert (await success(named)).text == "Action: Wait é"


async def test_reading_an_answer_neither_delays_others_nor_lasts_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    released = threading.Event()

    def slow(*_: object) -> object:
        released.wait()
        return {}

    monkeypatch.setattr(openai_compatible, "read_json", slow)
    try:
        caught, _ = await failure(answer("Action: Wait"), timeout=0.2, attempts=1)
    finally:
        released.set()
    assert caught.kind is KINDS.TIME_OUT


async def test_no_server_at_the_address() -> None:
    async with openai_server.endpoint(SILENCE) as gone:
        pass
    async with OpenAICompatibleModel(Endpoint("m", gone.url, attempts=2), key=KEY) as model:
        with pytest.raises(ModelError, match=r"127\.0\.0\.1") as caught:
            await model.complete(REQUEST)
    assert caught.value.kind is KINDS.ENDPOINT and caught.value.attempts == 2


async def test_answers_are_cut_at_a_megabyte() -> None:
    completion = await success(answer("é" * 2**19 + "end"))
    assert completion.finish_reason == "too-long"
    assert len(completion.text.encode()) == MAX_ANSWER_BYTES
    whole = await success(answer("x" * MAX_ANSWER_BYTES))
    assert whole.finish_reason == "stop" and len(whole.text) == MAX_ANSWER_BYTES


async def test_redirects_are_not_followed() -> None:
    async with openai_server.endpoint(answer("yes")) as other:
        there = other.url.replace("127.0.0.1", "localhost") + "/chat/completions"
        caught, requests = await failure(Reply(status=307, headers={"location": there}))
    assert caught.kind is KINDS.ENDPOINT and requests == 1
    assert there in str(caught)
    assert not other.received


@pytest.mark.parametrize("blanks", quick_sample([99_990, 270, 100_000, 104_080]))
async def test_cutting_a_message_leaves_no_part_of_a_key(blanks: int) -> None:
    said = "." * blanks if blanks < 300 else " " * blanks
    for reply in (
        error(400, said + KEY),
        Reply((said + KEY).encode(), status=400, content_type="text/plain"),
        answer(None, finish_reason="content_filter", refusal=said + KEY),
        Reply(json.dumps({"error": said + KEY}).encode()),
    ):
        caught, _ = await failure(reply, attempts=1)
        assert "sk-" not in str(caught)


async def test_a_key_in_an_answer_is_replaced() -> None:
    completion = await success(answer(f"Action: {KEY}", finish_reason=KEY))
    assert completion.text == "Action: [key]" and completion.finish_reason == "[key]"
    short = await success(answer("none of yours"), key="ours")
    assert short.text == "none of yours", "too short for a secret"


@pytest.mark.parametrize("key", ["a b", "schlüssel", "a\nb"])
def test_invalid_keys_are_refused(key: str) -> None:
    with pytest.raises(ModelError) as caught:
        OpenAICompatibleModel(Endpoint("m", "https://host/v1"), key=key)
    assert caught.value.kind is KINDS.NO_KEY and key not in str(caught.value)


async def test_text_parts_and_invalid_counts() -> None:
    parts = [{"type": "text", "text": "Action: "}, {"type": "text", "text": "Wait \ud800"}, 5]
    completion = await success(
        answer(parts, usage={"prompt_tokens": -3, "completion_tokens": "many"})  # type: ignore[arg-type]
    )
    assert completion.text == "Action: Wait ?" and completion.usage == Usage()


@pytest.mark.parametrize(
    "url", ["ftp://x", "localhost:8000", "https://me:secret@host/v1", "https://host/v1?key=secret"]
)
def test_invalid_base_urls_are_refused(url: str) -> None:
    with pytest.raises(WrongArgumentError) as caught:
        Endpoint("m", url)
    assert "secret" not in str(caught.value)


async def test_reserved_parameters_are_refused() -> None:
    with pytest.raises(WrongArgumentError, match="stream"):
        Endpoint("m", parameters={"stream": True})
    async with asking(answer("yes")) as (model, _):
        with pytest.raises(WrongArgumentError, match="messages"):
            await model.complete(ModelRequest((), parameters={"messages": []}))
        with pytest.raises(WrongArgumentError, match="JSON"):
            await model.complete(ModelRequest((), parameters={"stop": {"a", "b"}}))
