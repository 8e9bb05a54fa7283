"""Models behind OpenAI-compatible endpoints, asked through the OpenAI SDK."""

from __future__ import annotations

import asyncio
import json
import os
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from robotouille.errors import MissingExtraError, WrongArgumentError
from robotouille_evaluation.models.model import (
    NOTHING,
    Completion,
    ModelError,
    ModelErrorKind,
    ModelRequest,
)
from robotouille_evaluation.models.prices import Prices, listed_cost
from robotouille_evaluation.models.responses import (
    ModelAnswer,
    encodable,
    error_of_status,
    excerpt,
    read_completion,
    read_json,
)

if TYPE_CHECKING:
    from openai import AsyncOpenAI
    from openai._legacy_response import LegacyAPIResponse
    from openai.types.chat import ChatCompletion

OPENAI_URL = "https://api.openai.com/v1"
KEY_VARIABLES = ("ROBOTOUILLE_LLM_API_KEY", "OPENAI_API_KEY")
"""Environment variables with keys, in order of precedence."""
RESERVED = frozenset({"messages", "model", "stream", "n"})
"""Parameters that only this module sets."""
MAX_CONNECT_SECONDS = 10.0
MAX_KEY = 4096
"""Characters of a key."""
MAX_BODY_BYTES = 4_000_000
"""Most bytes of a response, uncompressed: the longest answer in escaped letters."""
MAX_ERROR_BYTES = 65_536
"""Bytes of an error's body that are read."""
MAX_PAUSE = 60.0
"""Longest pause in seconds before an unusable response is asked for again."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Address of a model, and how the model is asked. It is recorded, so it contains no key.

    Args:
        model: Name of the model at the endpoint.
        base_url: Address without `/chat/completions`.
        parameters: Sent with every request (`temperature`, `max_tokens`, or parameters that only
            this endpoint knows). Parameters of a request override them.
        prices: Prices of tokens; list prices of known providers if None.
        timeout: Seconds that an attempt waits for the response to begin, and for its body.
        attempts: Most requests sent for one answer.

    Raises:
        WrongArgumentError: The address is invalid or contains a password or query, where keys
            would be recorded; or a parameter is reserved or not JSON.
    """

    model: str
    base_url: str = OPENAI_URL
    parameters: Mapping[str, object] = field(default_factory=dict, hash=False)
    prices: Prices | None = None
    timeout: float = 120.0
    attempts: int = 6

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.base_url)
        except ValueError as error:
            raise WrongArgumentError(f"invalid base URL of a model: {error}") from None
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise WrongArgumentError("the base URL of a model begins with http:// or https://")
        if parts.username or parts.password or parts.query or parts.fragment:
            raise WrongArgumentError(
                "the base URL of a model is recorded, so it must not contain a password or query; "
                f"set the key in {KEY_VARIABLES[0]}"
            )
        _check_parameters(self.parameters)

    def cost(self, prompt_tokens: int, completion_tokens: int, cached: int) -> float | None:
        """Return the cost of these tokens, or None if their prices are unknown."""
        if self.prices is not None:
            return self.prices.cost(prompt_tokens, completion_tokens)
        return listed_cost(self.model, self.base_url, prompt_tokens, completion_tokens, cached)


def _check_parameters(parameters: Mapping[str, object]) -> None:
    if wrong := RESERVED & parameters.keys():
        raise WrongArgumentError(f"parameters of a model cannot set {', '.join(sorted(wrong))}")
    try:
        json.dumps(dict(parameters))
    except (TypeError, ValueError) as error:
        raise WrongArgumentError(f"parameters of a model must be JSON: {error}") from None


def key_from_environment(environment: Mapping[str, str], base_url: str) -> str | None:
    """Return the key for an endpoint from environment variables such as `os.environ`.

    `OPENAI_API_KEY` is also set for other programs, so it is sent over https only. Servers on the
    same machine usually need no key.
    """
    own, shared = (environment.get(name, "").strip() for name in KEY_VARIABLES)
    if own:
        return own
    return shared or None if urlsplit(base_url).scheme == "https" else None


def key_of(endpoint: Endpoint, key: str | None = None) -> str | None:
    """Return the key to send to an endpoint, by default the one from the environment.

    Raises:
        ModelError: OpenAI's own endpoint needs a key and none is set, or the key is invalid.
    """
    # A header with other characters would raise an error that quotes the key.
    key = (key or key_from_environment(os.environ, endpoint.base_url) or "").strip()
    if not (key.isascii() and key.isprintable() and " " not in key and len(key) <= MAX_KEY):
        raise ModelError(ModelErrorKind.NO_KEY, "the key contains characters that keys never have")
    if not key and endpoint.base_url == OPENAI_URL:
        raise ModelError(
            ModelErrorKind.NO_KEY,
            f"{OPENAI_URL} requires a key: set {' or '.join(KEY_VARIABLES)}; "
            "for another endpoint, set --base-url",
        )
    return key or None


class OpenAICompatibleModel:
    """Model behind an OpenAI-compatible endpoint, with one client for any number of episodes.

    The SDK retries failed requests. This class asks again only for responses that the SDK accepts
    but that contain no text. Close it with `aclose`, or use it as `async with`, in the event loop
    that used it first.

    Args:
        endpoint: Address of the model.
        key: Key of the endpoint; by default from the environment.

    Raises:
        MissingExtraError: The SDK is not installed.
        ModelError: OpenAI's own endpoint needs a key and none is set, or the key is invalid.
    """

    def __init__(self, endpoint: Endpoint, *, key: str | None = None) -> None:
        self.name = endpoint.model
        self.endpoint = endpoint
        self._key = key_of(endpoint, key)
        self._client = _client(endpoint, self._key)

    async def __aenter__(self) -> OpenAICompatibleModel:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close all connections."""
        await self._client.close()

    async def complete(self, request: ModelRequest) -> Completion:
        """Return the model's answer, after retries if necessary.

        Raises:
            ModelError: The endpoint did not answer.
            WrongArgumentError: A parameter of the request is reserved or not JSON.
        """
        import anyio

        _check_parameters(request.parameters)
        attempts, used = 0, NOTHING
        while True:
            try:
                response = await self._post(request, self.endpoint.attempts - attempts)
            except ModelError as error:
                raise error.in_total(attempts + error.attempts, used + error.usage) from None
            attempts += 1 + response.retries_taken
            try:
                answer = await self._answer(response)
            except ModelError as error:
                used += error.usage  # an empty answer was paid for, too
                if not error.retry_may_help or attempts >= self.endpoint.attempts:
                    raise error.in_total(attempts, used) from None
            else:
                seconds = response.elapsed.total_seconds()
                usage, reason = used + answer.usage, answer.finish_reason
                return Completion(answer.text, usage, seconds, reason, attempts)
            # Jitter keeps many episodes from coming back at the same moment.
            await anyio.sleep(min(MAX_PAUSE, 2.0 ** (attempts - 1)) * random.uniform(0.5, 1.0))

    async def _post(
        self, request: ModelRequest, attempts: int
    ) -> LegacyAPIResponse[ChatCompletion]:
        """Send a request at most `attempts` times until the status is 200."""
        import openai

        messages: list[Any] = [
            {"role": each.role, "content": encodable(each.content)} for each in request.messages
        ]
        # The SDK counts retries per call, so a repeated call gets the remaining ones.
        client = self._client
        if attempts < self.endpoint.attempts:
            client = client.with_options(max_retries=attempts - 1)
        try:
            return await client.chat.completions.with_raw_response.create(
                model=self.endpoint.model,
                messages=messages,
                extra_headers={} if self._key else {"Authorization": openai.Omit()},
                extra_body={**self.endpoint.parameters, **request.parameters},
            )
        except openai.APIStatusError as error:
            raise error_of_status(
                error.status_code,
                error.response.text,
                self._key,
                location=error.response.headers.get("location"),
                attempts=_attempts(error),
            ) from None
        except openai.APIConnectionError as error:
            raise self._unreachable(error.__cause__ or error, _attempts(error)) from None
        except Exception as error:  # The SDK lets some errors of aiohttp through.
            raise self._unreachable(error, 1) from None

    def _unreachable(self, cause: BaseException, attempts: int) -> ModelError:
        # The aiohttp transport reports refused and closed connections as timeouts, too.
        if isinstance(cause.__cause__ or cause, TimeoutError):
            detail = f"no answer within {self.endpoint.timeout:g} s"
            return ModelError(ModelErrorKind.TIME_OUT, detail, attempts=attempts)
        words = excerpt(" ".join(f"{type(cause).__name__} {cause}".split()), self._key)
        detail = f"{self.endpoint.base_url}: {words}"
        return ModelError(ModelErrorKind.ENDPOINT, detail, attempts=attempts)

    async def _answer(self, response: LegacyAPIResponse[ChatCompletion]) -> ModelAnswer:
        """Read a response in a thread, so that a large one delays no other episode."""
        try:
            async with asyncio.timeout(self.endpoint.timeout):
                return await asyncio.to_thread(self._read, response)
        except TimeoutError:
            detail = f"an answer that took more than {self.endpoint.timeout:g} s to read"
            raise ModelError(ModelErrorKind.TIME_OUT, detail) from None

    def _read(self, response: LegacyAPIResponse[ChatCompletion]) -> ModelAnswer:
        secrets = (self._key,) if self._key else ()
        # The SDK does not validate its own types, so the body is read as plain JSON.
        return read_completion(read_json(response.text, secrets), self.endpoint.cost, secrets)


def _attempts(error: Any) -> int:
    """Return the number of requests that the SDK sent before it raised an error."""
    return 1 + int(error.request.headers.get("x-stainless-retry-count", 0))


async def _read_body(seconds: float, response: Any) -> None:
    """Read a response's body before the SDK does, which limits neither its size nor its time."""
    body = bytearray()
    most = MAX_BODY_BYTES if response.is_success else MAX_ERROR_BYTES
    try:
        async with asyncio.timeout(seconds):
            async for piece in response.aiter_bytes():
                body += piece
                if len(body) > most:
                    if response.is_success:
                        raise ValueError(f"the answer has more than {most:,} bytes")
                    break
    except TimeoutError:
        raise TimeoutError from None
    finally:
        await response.aclose()
    response._content = bytes(body[:most])  # as `aread` does
    # The header could name an encoding that is slow to decode, such as `punycode`.
    response.encoding = "utf-8"


def _client(endpoint: Endpoint, key: str | None) -> AsyncOpenAI:
    try:
        import genai_prices  # noqa: F401 - imported here because it blocks the event loop for 0.1 s
        import openai

        # aiohttp: the SDK's usual transport searches all connections for each request, which is
        # slow with a hundred of them.
        class Client(openai.DefaultAioHttpClient):
            """HTTP client whose time limit holds also if single bytes of a head arrive."""

            async def send(self, *args: Any, **options: Any) -> Any:
                """Send a request and return the response, or raise TimeoutError."""
                try:
                    # The head and the body may each take the time limit.
                    async with asyncio.timeout(2 * endpoint.timeout):
                        return await super().send(*args, **options)
                except TimeoutError:
                    raise TimeoutError from None

        # Redirects: a conversation goes only to the given address.
        http_client = Client(
            follow_redirects=False,
            event_hooks={"response": [partial(_read_body, endpoint.timeout)]},
        )
    except (ImportError, RuntimeError):  # RuntimeError if only aiohttp is missing
        raise MissingExtraError("a model behind an endpoint", "llm") from None
    return openai.AsyncOpenAI(
        base_url=endpoint.base_url,
        api_key=key or "none",  # without a key, each request omits the header
        timeout=openai.Timeout(endpoint.timeout, connect=MAX_CONNECT_SECONDS),
        max_retries=endpoint.attempts - 1,
        http_client=http_client,
    )
