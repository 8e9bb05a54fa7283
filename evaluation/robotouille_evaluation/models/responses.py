"""Reading of endpoints' responses: text, usage, errors, and the removal of secrets.

Responses come from servers that anyone may run, so no type in them is trusted.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from robotouille_evaluation.models.model import NOTHING, ModelError, ModelErrorKind, Usage
from robotouille_evaluation.models.prices import CostOf

MAX_ANSWER_BYTES = 1_000_000
"""Longest text of an answer in UTF-8; the rest is cut."""
MAX_BRACKETS = 200_000
"""Most objects and lists in a response. Each takes memory for 3 bytes of text."""
MAX_TOKENS_COUNTED = 10**9
MAX_EXCERPT = 300
"""Characters of an endpoint's message that an error shows."""
MIN_SECRET = 8
"""Shortest value that counts as a secret; shorter ones are placeholders such as `EMPTY`."""
SECRET_NAME = re.compile(r"KEY|TOKEN|SECRET", re.IGNORECASE)
KEY_LIKE = re.compile(
    r"\b(?:sk|pk|gsk|xai|hf|r8|pplx|nvapi)[-_][\w*.\-]{6,}|\bkey-[\w*.\-]{6,}|\bAIza[\w*\-]{6,}"
    r"|\b[0-9a-f]{32,}\b|Bearer\s+\S+|\S{0,100}\*{3}\S*",
    re.IGNORECASE,
)
OVERFLOW = re.compile(
    r"context.?length|context.?window|context.?size|maximum context|prompt is too long"
    r"|input is too long|too many (?:input )?tokens|input tokens exceed",
    re.IGNORECASE,
)
"""Messages for too long conversations from OpenAI, vLLM, llama.cpp, Ollama and Anthropic."""

# Completions


@dataclass(frozen=True, slots=True)
class ModelAnswer:
    """Text of a chat completion, and why and at what cost it ended."""

    text: str
    finish_reason: str
    usage: Usage


def read_completion(
    completion: Mapping[str, object], cost: CostOf | None = None, secrets: Sequence[str] = ()
) -> ModelAnswer:
    """Return the answer in the JSON of a chat completion, with secrets replaced.

    Raises:
        ModelError: The JSON is not a chat completion, or has no text.
    """
    usage = _usage(completion.get("usage"), cost)
    error = completion.get("error")
    if isinstance(error, dict | str):  # Some gateways report errors with status 200.
        raise not_a_completion(f"an error: {excerpt(error, *secrets)}", _charged(usage))
    choice = _first_choice(completion.get("choices"), _charged(usage))
    reason = choice.get("finish_reason")
    # The reason is recorded, and an endpoint could return the key in it.
    finish_reason = (excerpt(reason, *secrets)[:40] if isinstance(reason, str) else "") or "stop"
    message = _mapping(choice.get("message"))
    text = without_secrets(_text(message.get("content")), secrets)
    if not text.strip():
        raise _no_text(message, finish_reason, usage, secrets)
    cut = cut_answer(text)
    return ModelAnswer(cut, "too-long" if len(cut) < len(text) else finish_reason, usage)


def read_json(body: str, secrets: Sequence[str] = ()) -> Mapping[str, object]:
    """Return a body's JSON object, or raise `ModelError`."""
    if body.count("{") + body.count("[") > MAX_BRACKETS:
        raise not_a_completion(f"more than {MAX_BRACKETS:,} objects and lists")
    try:
        return _mapping(json.loads(body))
    except (ValueError, RecursionError):
        raise not_a_completion(f"{excerpt(body, *secrets)[:60]!r} instead of JSON") from None


def not_a_completion(found: str, usage: Usage = NOTHING) -> ModelError:
    """Return the error for a response that is not a chat completion.

    Args:
        usage: Tokens that the response charges nevertheless.
    """
    detail = f"the endpoint answered with {found}"
    return ModelError(ModelErrorKind.ENDPOINT, detail, retry_may_help=True, usage=usage)


def encodable(text: str) -> str:
    """Return the text without lone surrogates, which UTF-8 cannot encode."""
    return text.encode(errors="replace").decode()


def cut_answer(text: str) -> str:
    """Return at most the first `MAX_ANSWER_BYTES` of an encodable text."""
    # UTF-8 has at most four bytes per character, so short texts need no encoding.
    if len(text) * 4 <= MAX_ANSWER_BYTES:
        return text
    return text.encode()[:MAX_ANSWER_BYTES].decode(errors="ignore")


def _no_text(
    message: Mapping[str, object], finish_reason: str, usage: Usage, secrets: Sequence[str]
) -> ModelError:
    if message.get("tool_calls") or message.get("function_call"):
        detail = "a tool call instead of text"
    elif message.get("refusal"):
        detail = f"the model declined: {excerpt(message['refusal'], *secrets)}"
    else:
        detail = f"an answer without text (finish reason {finish_reason!r})"
    # Other reasons (length, content_filter) would recur, and every attempt is paid for.
    again = finish_reason in ("stop", "tool_calls")
    return ModelError(ModelErrorKind.EMPTY, detail, retry_may_help=again, usage=usage)


def _mapping(value: object) -> Mapping[str, object]:
    return value if isinstance(value, dict) else {}


def _first_choice(choices: object, charged: Usage) -> Mapping[str, object]:
    if isinstance(choices, list) and choices and isinstance(choices[0], dict):
        return _mapping(choices[0])
    found = "no choice" if choices == [] else "JSON that is not a chat completion"
    raise not_a_completion(found, charged)


def _text(content: object) -> str:
    """Return the text of a message, which is a string or a list with text parts."""
    if isinstance(content, list):
        parts = [part.get("text") for part in content if isinstance(part, dict)]
        content = "".join(part for part in parts if isinstance(part, str))
    return encodable(content) if isinstance(content, str) else ""


def _usage(usage: object, cost: CostOf | None) -> Usage:
    """Return the reported tokens with their cost, which is unknown if a count is missing."""
    counted = _mapping(usage)
    sent, received = _count(counted, "prompt_tokens"), _count(counted, "completion_tokens")
    if sent is None or received is None or cost is None:
        return Usage(sent or 0, received or 0)
    # Providers charge less for prompt tokens that they have cached.
    cached = _count(_mapping(counted.get("prompt_tokens_details")), "cached_tokens") or 0
    return Usage(sent, received, cost(sent, received, min(cached, sent)))


def _charged(usage: Usage) -> Usage:
    """Return the usage of a response without an answer, which costs nothing without tokens."""
    return usage if usage.prompt_tokens or usage.completion_tokens else NOTHING


def _count(usage: Mapping[str, object], name: str) -> int | None:
    """Return a count of tokens; None if it is missing or not a count."""
    value = usage.get(name)
    if type(value) is int and 0 <= value <= MAX_TOKENS_COUNTED:
        return value
    return None


# Errors


def error_of_status(
    status: int, body: str, key: str | None, *, location: str | None = None, attempts: int = 1
) -> ModelError:
    """Return the error for a response with a status from 300.

    Args:
        body: The response's body, which may repeat the key.
        key: The key that was sent.
        location: The response's `Location`.
        attempts: Number of requests sent.
    """
    detail = excerpt(_message(body), key) or "no reason given"
    kind = _kind_of_status(status, body, key)
    if status < 400 and location:
        target = excerpt(location, key)
        detail = f"redirects are not followed; use the address {target} if you trust it"
    if kind is ModelErrorKind.NO_KEY:
        detail = f"the endpoint requires a key: set ROBOTOUILLE_LLM_API_KEY ({detail})"
    return ModelError(kind, f"status {status}: {detail}", attempts=attempts)


def _kind_of_status(status: int, body: str, key: str | None) -> ModelErrorKind:
    if status in (400, 413, 422) and OVERFLOW.search(body):
        return ModelErrorKind.CONTEXT_OVERFLOW
    if status == 401 and key is None:
        return ModelErrorKind.NO_KEY
    if status == 429:
        return ModelErrorKind.RATE_LIMITED
    # A JSON 404 comes from an endpoint without the model; other pages come from no endpoint.
    if status < 400 or (status in (404, 405) and not _is_object(body)):
        return ModelErrorKind.ENDPOINT
    return ModelErrorKind.SERVER if status >= 500 else ModelErrorKind.REFUSED


def _is_object(body: str) -> bool:
    try:
        return isinstance(json.loads(body), dict)
    except (ValueError, RecursionError):
        return False


def _message(body: str) -> str:
    """Return the message of a JSON error, or the body itself, on one line."""
    words: object = body
    if _is_object(body):
        whole = json.loads(body)
        error = whole.get("error", whole)
        words = error.get("message", error) if isinstance(error, dict) else error
    return " ".join(str(words).split())


# Secrets


def without_key(text: str, *keys: str | None) -> str:
    """Return the text with keys, and whatever looks like a key, replaced by `[key]`."""
    return KEY_LIKE.sub("[key]", _without(text, keys))


def excerpt(words: object, *keys: str | None) -> str:
    """Return the beginning of an endpoint's message without keys and lone surrogates.

    Known keys are removed before the text is cut, because a cut could leave half a key. The slow
    pattern for unknown keys is applied only to the part that could be shown.
    """
    return encodable(without_key(_without(str(words), keys)[: 4 * MAX_EXCERPT])[:MAX_EXCERPT])


def without_secrets(text: str, secrets: Iterable[str]) -> str:
    """Return an answer with secrets replaced and nothing else changed."""
    return _without(text, (secret for secret in secrets if len(secret) >= MIN_SECRET))


def secrets_in(environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return the values of variables that are named like keys, the longest first."""
    found = {
        value.strip()
        for name, value in environment.items()
        if SECRET_NAME.search(name) and len(value.strip()) >= MIN_SECRET
    }
    return tuple(sorted(found, key=len, reverse=True))


def _without(text: str, keys: Iterable[str | None]) -> str:
    for key in filter(None, keys):
        text = text.replace(key, "[key]")
    return text
