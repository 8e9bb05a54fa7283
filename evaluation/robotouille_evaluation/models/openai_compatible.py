"""Models behind an OpenAI-compatible endpoint, for many episodes at once."""

from __future__ import annotations

import asyncio
import json
import os
import random
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from robotouille.errors import MissingExtraError, WrongArgumentError
from robotouille_evaluation.models.answers import MAX_BODY_BYTES, Answer, encodable, read_answer
from robotouille_evaluation.models.failures import refusal, shown
from robotouille_evaluation.models.model import (
    Completion,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
)
from robotouille_evaluation.models.prices import Prices
from robotouille_evaluation.models.retries import RetryPolicy

if TYPE_CHECKING:
    from httpx2 import Response
    from openai import AsyncOpenAI

__all__ = [
    "KEY_VARIABLES",
    "OPENAI_URL",
    "Endpoint",
    "OpenAICompatibleModel",
    "key_from_environment",
    "key_of",
]

OPENAI_URL = "https://api.openai.com/v1"
KEY_VARIABLES = ("ROBOTOUILLE_LLM_API_KEY", "OPENAI_API_KEY")
"""Where keys are looked for, in this order."""
RESERVED = frozenset({"messages", "model", "stream", "n"})
"""What no parameter may say, because the model says it."""
MAX_CONNECT_SECONDS = 10.0
MAX_REFUSAL_BYTES = 100_000
"""How much is read of a body of another status than 200: the beginning says why."""
MAX_KEY = 4096
"""Characters of a key."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a model is and how it is asked. It is recorded, so there is no key in it.

    Args:
        model: The name that the endpoint knows.
        base_url: Up to and without `/chat/completions`.
        parameters: Sent with every request (`temperature`, `max_tokens`, or what only this
            endpoint knows); those of a request come first.
        prices: Of tokens, if costs are to be reported.
        timeout: Seconds for one attempt, from its first byte to the last of the answer.
        retries: What is done when an attempt fails.
        max_concurrent: Requests under way at once; others wait their turn.

    Raises:
        WrongArgumentError: No usable address, or one with a password or a query in it (keys
            do not belong there), or a parameter that the model sets itself or that is no JSON.
    """

    model: str
    base_url: str = OPENAI_URL
    parameters: Mapping[str, object] = field(default_factory=dict, hash=False)
    prices: Prices | None = None
    timeout: float = 120.0
    retries: RetryPolicy = field(default_factory=RetryPolicy)
    max_concurrent: int = 100

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.base_url)
        except ValueError as error:
            raise WrongArgumentError(f"the base URL of a model is none: {error}") from None
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise WrongArgumentError("the base URL of a model begins with http:// or https://")
        if parts.username or parts.password or parts.query or parts.fragment:
            raise WrongArgumentError(
                "the base URL of a model has neither password nor query: it is recorded; "
                f"give the key in {KEY_VARIABLES[0]}"
            )
        _check_parameters(self.parameters)


def _check_parameters(parameters: Mapping[str, object]) -> None:
    if wrong := RESERVED & parameters.keys():
        raise WrongArgumentError(f"parameters of a model cannot set {', '.join(sorted(wrong))}")
    try:
        json.dumps(dict(parameters))
    except (TypeError, ValueError) as error:
        raise WrongArgumentError(f"parameters of a model are JSON: {error}") from None


def key_from_environment(environment: Mapping[str, str], base_url: str) -> str | None:
    """The key for an endpoint: ROBOTOUILLE_LLM_API_KEY, else OPENAI_API_KEY.

    The latter is meant for others' programs, too, and is therefore sent over https only; local
    servers need none.

    Args:
        environment: Such as `os.environ`.
        base_url: The endpoint's.
    """
    ours, openai = (environment.get(name, "").strip() for name in KEY_VARIABLES)
    if ours:
        return ours
    return openai or None if urlsplit(base_url).scheme == "https" else None


def key_of(endpoint: Endpoint, key: str | None = None) -> str | None:
    """The key that an endpoint is sent.

    Args:
        endpoint: Where it is.
        key: By default from the environment.

    Raises:
        ModelError: OpenAI's own endpoint and no key, or what is given is none.
    """
    key = (key or key_from_environment(os.environ, endpoint.base_url) or "").strip()
    if not (key.isascii() and key.isprintable() and " " not in key and len(key) <= MAX_KEY):
        raise ModelError(ModelErrorKind.NO_KEY, "the key has characters that no key has")
    if not key and endpoint.base_url == OPENAI_URL:
        what = f"{OPENAI_URL} wants a key: set {' or '.join(KEY_VARIABLES)}; "
        raise ModelError(ModelErrorKind.NO_KEY, f"{what}--base-url is for an endpoint of your own")
    return key or None


class OpenAICompatibleModel:
    """A model behind an OpenAI-compatible endpoint: one client for any number of episodes.

    It belongs to the event loop in which it is first used; close it there with `aclose`, or use it
    as `async with`.

    Args:
        endpoint: Where it is and how it is asked.
        key: For the endpoint; by default from the environment.
        rng: Draws the pauses between attempts.
        clock: Seconds, for measuring.
        sleep: Waits for so many seconds.
        wall: Unix time, for a `Retry-After` that is a date.

    Raises:
        MissingExtraError: The SDK is not installed.
        ModelError: OpenAI's own endpoint and no key, or what is given is none.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        *,
        key: str | None = None,
        rng: random.Random | None = None,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], Awaitable[object]] = asyncio.sleep,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self.name = endpoint.model
        self.endpoint = endpoint
        self._key = key_of(endpoint, key)
        self._rng = rng or random.Random()
        self._clock, self._sleep, self._wall = clock, sleep, wall
        self._client = _client(endpoint, self._key, self._refuse)
        self._slots = asyncio.Semaphore(endpoint.max_concurrent)

    async def __aenter__(self) -> OpenAICompatibleModel:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close all connections."""
        await self._client.close()

    async def complete(self, request: ModelRequest) -> Completion:
        """The model's answer, after as many attempts as it takes and the policy grants.

        Args:
            request: The conversation, and parameters that come before the endpoint's.

        Raises:
            ModelError: There is none.
            WrongArgumentError: A parameter that the model sets itself, or that is no JSON.
        """
        _check_parameters(request.parameters)
        body = self._body(request)
        attempt, used = 0, Usage()
        while True:
            attempt += 1
            try:
                async with self._slots:
                    begun = self._clock()
                    answer = await self._ask(body)
                    seconds = self._clock() - begun
            except ModelError as error:
                used += error.usage
                pause = self.endpoint.retries.pause(attempt, error, self._rng)
                if pause is None:
                    raise error.after(attempt, used) from None
                await self._sleep(pause)
            else:
                reason = answer.finish_reason
                return Completion(answer.text, used + answer.usage, seconds, reason, attempt)

    def _body(self, request: ModelRequest) -> dict[str, object]:
        messages = [
            {"role": each.role, "content": encodable(each.content)} for each in request.messages
        ]
        given = {**self.endpoint.parameters, **request.parameters}
        return {"model": self.endpoint.model, "messages": messages, **given}

    async def _ask(self, body: dict[str, object]) -> Answer:
        """One attempt."""
        try:
            async with asyncio.timeout(self.endpoint.timeout):
                content_type, answered = await self._post(body)
        except TimeoutError:
            what = f"no whole answer within {self.endpoint.timeout:g} s"
            raise ModelError(ModelErrorKind.TIME_OUT, what, retry_may_help=True) from None
        secrets = (self._key,) if self._key else ()
        return read_answer(content_type, answered, self.endpoint.prices, secrets)

    async def _post(self, body: dict[str, object]) -> tuple[str, bytes]:
        """The content type and the body of an answer of status 200."""
        import openai

        completions = self._client.chat.completions.with_streaming_response
        try:
            # The SDK would check every message of a long conversation again: it gets none.
            asked: Any = {"model": self.endpoint.model, "messages": [], "extra_body": body}
            if self._key is None:
                asked["extra_headers"] = {"Authorization": openai.Omit()}
            async with completions.create(**asked) as response:
                content_type = response.headers.get("content-type", "")
                return content_type, await self._read(response.iter_bytes())
        except ModelError:
            raise
        except openai.APIConnectionError as error:
            if isinstance(error.__cause__, ModelError):
                raise error.__cause__ from None
            raise self._unreachable(error.__cause__ or error) from None
        except Exception as error:  # the SDK lets some of its HTTP library's through
            raise self._unreachable(error) from None

    async def _refuse(self, response: Response) -> None:
        """Raise what a refusal says, before the SDK reads all of it, which may have no end."""
        if response.is_success:
            return
        read = bytearray()
        async for piece in response.aiter_bytes():
            read += piece
            if len(read) > MAX_REFUSAL_BYTES + MAX_KEY:
                break
        said = read.decode(errors="replace")
        if self._key:  # Before it is cut; a part of one at the end of what was read is left out.
            said = said.replace(self._key, "[key]")
        body = said[:MAX_REFUSAL_BYTES]
        headers = {name.lower(): value for name, value in response.headers.items()}
        raise refusal(response.status_code, headers, body, self._key, self._wall())

    @staticmethod
    async def _read(pieces: AsyncIterator[bytes]) -> bytes:
        read = bytearray()
        async for piece in pieces:
            read += piece
            if len(read) > MAX_BODY_BYTES:
                what = f"an answer of more than {MAX_BODY_BYTES:,} bytes"
                raise ModelError(ModelErrorKind.TOO_LONG, what)
        return bytes(read)

    def _unreachable(self, error: BaseException) -> ModelError:
        words = " ".join(f"{type(error).__name__} {error}".split())
        said = shown(words, self._key)
        what = f"{self.endpoint.base_url}: {said}"
        return ModelError(ModelErrorKind.ENDPOINT, what, retry_may_help=True)


def _client(
    endpoint: Endpoint, key: str | None, answered: Callable[[Response], Awaitable[None]]
) -> AsyncOpenAI:
    """The SDK's client, without attempts of its own.

    It goes nowhere else than it is told: conversations are for nobody but the endpoint.
    """
    try:
        import openai

        http_client = openai.DefaultAioHttpClient(
            follow_redirects=False, event_hooks={"response": [answered]}
        )
    except (ImportError, RuntimeError):  # the latter where aiohttp alone is missing
        raise MissingExtraError("a model behind an endpoint", "llm") from None
    return openai.AsyncOpenAI(
        base_url=endpoint.base_url,
        api_key=key or "none",  # left out of each request
        timeout=openai.Timeout(None, connect=MAX_CONNECT_SECONDS),
        max_retries=0,
        # The SDK's usual one looks at all connections for each request: slow with a hundred.
        http_client=http_client,
    )
