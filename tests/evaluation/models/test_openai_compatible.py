"""An endpoint's good and bad answers, over real sockets; pauses are noted, not waited for."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import random
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

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
    RetryPolicy,
    Usage,
)
from robotouille_evaluation.models.answers import MAX_ANSWER_BYTES
from robotouille_evaluation.models.openai_compatible import key_from_environment
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

if importlib.util.find_spec("openai") is None:  # Not imported: that takes a second.
    pytest.skip("needs openai", allow_module_level=True)

KEY = "sk-test-0123456789abcdef"
REQUEST = ModelRequest(
    (Message("system", "You cook."), Message("user", "What now?")), parameters={"seed": 7}
)
KINDS = ModelErrorKind


class Pauses(list[float]):
    """Seconds that a model wanted to wait."""

    async def __call__(self, seconds: float) -> None:
        self.append(seconds)


@asynccontextmanager
async def asking(
    *script: Reply, key: str | None = KEY, **options: Any
) -> AsyncIterator[tuple[OpenAICompatibleModel, ScriptedEndpoint, Pauses]]:
    pauses = Pauses()
    async with openai_server.endpoint(*script) as server:
        settings = Endpoint("scripted", server.url, **options)
        rng = random.Random(1)
        model = OpenAICompatibleModel(settings, key=key, rng=rng, sleep=pauses, wall=lambda: 0.0)
        async with model:
            yield model, server, pauses


async def failure(*script: Reply, **options: Any) -> tuple[ModelError, int]:
    """The error that a script ends in, and how many requests came."""
    async with asking(*script, **options) as (model, server, _):
        with pytest.raises(ModelError) as caught:
            await model.complete(REQUEST)
        assert KEY not in str(caught.value) and KEY not in repr(caught.value)
        return caught.value, len(server.received)


async def success(*script: Reply, **options: Any) -> tuple[Completion, Pauses]:
    async with asking(*script, **options) as (model, _, pauses):
        return await model.complete(REQUEST), pauses


async def test_an_answer() -> None:
    options = {"parameters": {"temperature": 0.7, "seed": 1, "top_k": 5}, "prices": Prices(2, 10)}
    async with asking(answer("Action: Wait"), **options) as (model, server, _):
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


async def test_a_server_without_keys_is_sent_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTOUILLE_LLM_API_KEY", raising=False)
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    async with asking(answer("yes"), key=None) as (model, server, _):
        await model.complete(REQUEST)
    assert "authorization" not in server.received[0].headers
    monkeypatch.setenv("ROBOTOUILLE_LLM_API_KEY", "ours")
    async with asking(answer("yes"), key=None) as (model, server, _):
        await model.complete(REQUEST)
    assert server.received[0].headers["authorization"] == "Bearer ours"


def test_where_keys_come_from() -> None:
    both = {"ROBOTOUILLE_LLM_API_KEY": "ours", "OPENAI_API_KEY": "theirs"}
    assert key_from_environment(both, "https://example.org/v1") == "ours"
    theirs = {"OPENAI_API_KEY": "theirs", "ROBOTOUILLE_LLM_API_KEY": " "}
    assert key_from_environment(theirs, "https://example.org/v1") == "theirs"
    assert key_from_environment(theirs, "http://127.0.0.1:8000/v1") is None
    assert key_from_environment({}, "https://example.org/v1") is None


def test_no_key_for_openai(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROBOTOUILLE_LLM_API_KEY", "OPENAI_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ModelError, match="ROBOTOUILLE_LLM_API_KEY") as caught:
        OpenAICompatibleModel(Endpoint("gpt"))
    assert caught.value.kind is KINDS.NO_KEY
    assert "api.openai.com" in str(caught.value) and "--base-url" in str(caught.value)


def test_it_says_which_extra_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_aiohttp(**_: object) -> None:
        raise RuntimeError("install the extra aiohttp")

    monkeypatch.setattr("openai.DefaultAioHttpClient", without_aiohttp)
    with pytest.raises(MissingExtraError, match=r"robotouille\[llm\]"):
        OpenAICompatibleModel(Endpoint("m"), key=KEY)
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[llm\]"):
        OpenAICompatibleModel(Endpoint("m"), key=KEY)


async def test_no_key_where_one_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTOUILLE_LLM_API_KEY", raising=False)
    caught, requests = await failure(error(401, "who are you"), key=None)
    assert caught.kind is KINDS.NO_KEY and "who are you" in str(caught) and requests == 1


async def test_refusals_never_show_the_key() -> None:
    caught, requests = await failure(error(401, f"Incorrect API key provided: {KEY}, sk-abc***xyz"))
    assert caught.kind is KINDS.REFUSED and requests == 1 and caught.status == 401
    assert "[key]" in str(caught) and "xyz" not in str(caught)


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
        (Reply(b"{}", headers={"x-long": "x" * 100_000}), KINDS.ENDPOINT, True),
        (Raw(b"SSH-2.0-OpenSSH_9.2\r\n\r\n"), KINDS.ENDPOINT, True),
        (HANG_UP, KINDS.ENDPOINT, True),
        (stream("Action: Wa", ended=False), KINDS.ENDPOINT, True),
        (error(500), KINDS.SERVER, True),
        (error(503), KINDS.SERVER, True),
        (error(408), KINDS.REFUSED, True),
        (error(429, "slow down"), KINDS.RATE_LIMITED, True),
        (error(429, "You exceeded your current quota", "insufficient_quota"), KINDS.RATE_LIMITED,
         False),
        (error(429, retry_after="3600"), KINDS.RATE_LIMITED, False),
        (answer(""), KINDS.EMPTY, True),
        (answer(" \n"), KINDS.EMPTY, True),
        (answer(None, finish_reason="length"), KINDS.EMPTY, False),
        (answer(None, finish_reason="content_filter", refusal="No."), KINDS.EMPTY, False),
        (tool_call(), KINDS.EMPTY, True),
    ],
)  # fmt: skip
async def test_bad_answers(reply: Reply, kind: ModelErrorKind, again: bool) -> None:
    caught, requests = await failure(reply, retries=RetryPolicy(attempts=3))
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
async def test_a_conversation_that_is_too_long(status: int, said: str) -> None:
    caught, requests = await failure(error(status, said))
    assert caught.kind is KINDS.CONTEXT_OVERFLOW and requests == 1


async def test_what_was_paid_for_is_counted_on_failure() -> None:
    caught, _ = await failure(tool_call(), prices=Prices(1, 1), retries=RetryPolicy(attempts=2))
    assert caught.usage == Usage(200, 40, pytest.approx(0.00024)) and "tool call" in str(caught)


async def test_it_tries_again_and_counts_everything() -> None:
    script = [error(500), HANG_UP, answer(""), answer("at last")]
    completion, pauses = await success(*script)
    assert completion.text == "at last" and completion.attempts == 4
    assert completion.usage == Usage(200, 40)
    assert 0.5 <= pauses[0] <= 1 <= pauses[1] <= 2 <= pauses[2] <= 4


@pytest.mark.parametrize(
    ("headers", "asked"),
    [
        ({"retry_after": "7"}, 7),
        ({"retry_after_ms": "1500", "retry_after": "9"}, 1.5),
        ({"retry_after": "Thu, 01 Jan 1970 00:00:20 GMT"}, 20),
        ({"retry_after": "soon"}, 0),
        ({"retry_after": "-5"}, 0),
        ({"retry_after": "1e400"}, 0),
    ],
)
async def test_it_waits_as_long_as_it_is_asked_to(headers: dict[str, str], asked: float) -> None:
    _, (pause,) = await success(error(429, **headers), answer("yes"))
    assert asked + 0.5 <= pause <= asked + 1


async def test_silence() -> None:
    caught, requests = await failure(SILENCE, timeout=0.05, retries=RetryPolicy(attempts=2))
    assert caught.kind is KINDS.TIME_OUT and requests == 2


async def test_an_answer_that_stops_in_the_middle() -> None:
    stalled = Reply(answer("Action: Wait").body, stalls=True)
    caught, _ = await failure(stalled, timeout=0.2, retries=RetryPolicy(attempts=1))
    assert caught.kind is KINDS.TIME_OUT


async def test_nobody_listens() -> None:
    async with openai_server.endpoint(SILENCE) as gone:
        pass
    pauses = Pauses()
    settings = Endpoint("scripted", gone.url, retries=RetryPolicy(attempts=2))
    async with OpenAICompatibleModel(settings, key=KEY, sleep=pauses) as model:
        with pytest.raises(ModelError, match=r"127\.0\.0\.1") as caught:
            await model.complete(REQUEST)
    assert caught.value.kind is KINDS.ENDPOINT and len(pauses) == 1


async def test_a_megabyte_is_cut_and_marked() -> None:
    completion, _ = await success(answer("é" * 2**19 + "end"))
    assert completion.finish_reason == "too-long"
    assert len(completion.text.encode()) == MAX_ANSWER_BYTES
    whole, _ = await success(answer("x" * MAX_ANSWER_BYTES))
    assert whole.finish_reason == "stop" and len(whole.text) == MAX_ANSWER_BYTES


async def test_far_more_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotouille_evaluation.models.openai_compatible.MAX_BODY_BYTES", 100_000)
    caught, requests = await failure(answer("x" * 1_000_000))
    assert caught.kind is KINDS.TOO_LONG and requests == 1


async def test_an_answer_that_the_endpoint_cut() -> None:
    completion, _ = await success(answer("Action: Mo", finish_reason="length"))
    assert completion.text == "Action: Mo" and completion.finish_reason == "length"


async def test_a_redirection_is_not_followed() -> None:
    async with openai_server.endpoint(answer("yes")) as other:
        there = other.url.replace("127.0.0.1", "localhost") + "/chat/completions"
        caught, requests = await failure(Reply(status=307, headers={"location": there}))
    assert caught.kind is KINDS.ENDPOINT and requests == 1
    assert there in str(caught)
    assert not other.received


async def test_an_error_is_not_read_to_its_end() -> None:
    """It is far from over when it is told: 100 MB are announced that never come."""
    endless = Reply(b"why " * 250_000, status=500, missing=10**8, content_type="text/plain")
    caught, _ = await failure(endless, retries=RetryPolicy(attempts=1))
    assert caught.kind is KINDS.SERVER and "why why" in str(caught)


@pytest.mark.parametrize("blanks", [270, 99_990, 100_000, 104_080])
async def test_no_part_of_a_key_is_left_where_words_are_cut(blanks: int) -> None:
    said = "." * blanks if blanks < 300 else " " * blanks
    for reply in (
        error(400, said + KEY),
        Reply((said + KEY).encode(), status=400, content_type="text/plain"),
        answer(None, finish_reason="content_filter", refusal=said + KEY),
        Reply(json.dumps({"error": said + KEY}).encode()),
    ):
        caught, _ = await failure(reply, retries=RetryPolicy(attempts=1))
        assert "sk-" not in str(caught)


async def test_an_answer_that_repeats_the_key() -> None:
    completion, _ = await success(answer(f"Action: {KEY}", finish_reason=KEY))
    assert completion.text == "Action: [key]" and completion.finish_reason == "[key]"
    pieces, _ = await success(stream("Action: ", KEY[:9], KEY[9:]))
    assert pieces.text == "Action: [key]"
    short, _ = await success(answer("none of yours"), key="ours")
    assert short.text == "none of yours", "no secret: a word"


@pytest.mark.parametrize("key", ["a b", "schlüssel", "a\nb"])
def test_keys_that_are_none(key: str) -> None:
    with pytest.raises(ModelError) as caught:
        OpenAICompatibleModel(Endpoint("m", "https://host/v1"), key=key)
    assert caught.value.kind is KINDS.NO_KEY and key not in str(caught.value)


async def test_a_stream_that_nobody_asked_for() -> None:
    completion, _ = await success(stream("Action", ": ", "Wait", usage={"completion_tokens": 3}))
    assert completion.text == "Action: Wait" and completion.usage == Usage(0, 3)


async def test_odd_answers_are_taken_as_they_are() -> None:
    parts = [{"type": "text", "text": "Action: "}, {"type": "text", "text": "Wait \ud800"}, 5]
    completion, _ = await success(
        answer(parts, usage={"prompt_tokens": -3, "completion_tokens": "many"})  # type: ignore[arg-type]
    )
    assert completion.text == "Action: Wait ?" and completion.usage == Usage()


async def test_a_hundred_episodes_share_a_client() -> None:
    under_way = most = 0

    async def one(model: OpenAICompatibleModel) -> None:
        nonlocal under_way, most
        under_way += 1
        most = max(most, under_way)
        assert (await model.complete(REQUEST)).text == "yes"
        under_way -= 1

    async with asking(answer("yes"), max_concurrent=10) as (model, server, _):
        await asyncio.gather(*(one(model) for _ in range(100)))
    assert most == 100 and len(server.received) == 100


async def test_a_cancelled_request_lets_the_next_one_through() -> None:
    async with asking(SILENCE, answer("yes"), max_concurrent=1) as (model, server, _):
        first = asyncio.create_task(model.complete(REQUEST))
        while not server.received:
            await asyncio.sleep(0)
        first.cancel()
        assert (await model.complete(REQUEST)).text == "yes"
        assert first.cancelled()


@pytest.mark.parametrize(
    "url", ["ftp://x", "localhost:8000", "https://me:secret@host/v1", "https://host/v1?key=secret"]
)
def test_base_urls_that_will_not_do(url: str) -> None:
    with pytest.raises(WrongArgumentError) as caught:
        Endpoint("m", url)
    assert "secret" not in str(caught.value)


async def test_parameters_that_the_model_sets_itself() -> None:
    with pytest.raises(WrongArgumentError, match="stream"):
        Endpoint("m", parameters={"stream": True})
    async with asking(answer("yes")) as (model, _, _):
        with pytest.raises(WrongArgumentError, match="messages"):
            await model.complete(ModelRequest((), parameters={"messages": []}))
        with pytest.raises(WrongArgumentError, match="JSON"):
            await model.complete(ModelRequest((), parameters={"stop": {"a", "b"}}))


async def test_a_lone_surrogate_is_sent_as_a_question_mark() -> None:
    async with asking(answer("yes")) as (model, server, _):
        await model.complete(ModelRequest((Message("user", "\ud800 and 汉"),)))
    assert server.received[0].body["messages"][0]["content"] == "? and 汉"


def test_what_is_recorded_has_no_key() -> None:
    model = OpenAICompatibleModel(Endpoint("m", "https://host/v1"), key=KEY)
    assert KEY not in repr(model.endpoint) and KEY not in repr(model) and KEY not in model.name
