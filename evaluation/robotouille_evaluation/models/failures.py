"""What an endpoint's refusals mean."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from datetime import UTC
from email.utils import parsedate_to_datetime

from robotouille_evaluation.models.model import ModelError, ModelErrorKind

__all__ = ["refusal", "secrets_in", "shown", "without_key", "without_secrets"]

MAX_SHOWN = 300
"""Characters of an endpoint's words that are shown."""
MIN_SECRET = 8
"""Characters of a secret; what is shorter is a placeholder, such as `EMPTY`, or a word."""
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
"""How endpoints say that a conversation is too long: OpenAI, vLLM, llama.cpp, Ollama, Anthropic."""
NO_QUOTA = re.compile(r"insufficient_quota|billing|exceeded your current quota", re.IGNORECASE)


def without_key(text: str, *keys: str | None) -> str:
    """A text in which nothing is left of keys, nor of what looks like one."""
    return KEY_LIKE.sub("[key]", _without(text, keys))


def shown(words: object, *keys: str | None) -> str:
    """The beginning of what an endpoint says, without keys.

    It is cut only when keys are struck out, so that no part of one is left. What looks like a key
    is looked for only where it could be shown: a text may have megabytes.
    """
    return without_key(_without(str(words), keys)[: 4 * MAX_SHOWN])[:MAX_SHOWN]


def without_secrets(text: str, secrets: Iterable[str]) -> str:
    """An answer in which nothing is left of secrets, and in which nothing else is changed."""
    return _without(text, (secret for secret in secrets if len(secret) >= MIN_SECRET))


def _without(text: str, keys: Iterable[str | None]) -> str:
    for key in filter(None, keys):
        text = text.replace(key, "[key]")
    return text


def secrets_in(environment: Mapping[str, str]) -> tuple[str, ...]:
    """The values of variables that are named like keys, the longest first.

    Args:
        environment: Such as `os.environ`.
    """
    found = {
        value.strip()
        for name, value in environment.items()
        if SECRET_NAME.search(name) and len(value.strip()) >= MIN_SECRET
    }
    return tuple(sorted(found, key=len, reverse=True))


def refusal(
    status: int, headers: Mapping[str, str], body: str, key: str | None, now: float
) -> ModelError:
    """The error that an answer with another status than 200 stands for.

    Args:
        status: Of HTTP, from 300.
        headers: With lower-case names.
        body: What the endpoint says, which may repeat the key.
        key: The one that was sent, if one was.
        now: Unix time, for a `Retry-After` that is a date.
    """
    said = shown(_words(body), key) or "no reason given"
    if status < 400 and headers.get("location"):
        there = shown(headers["location"], key)
        said = f"redirects to {there}; it is not followed: give that address if it is meant"
    kind, retry_may_help = _meaning(status, body, key)
    if kind is ModelErrorKind.NO_KEY:
        said = f"the endpoint wants a key: set ROBOTOUILLE_LLM_API_KEY ({said})"
    return ModelError(
        kind,
        f"status {status}: {said}",
        retry_may_help=retry_may_help,
        status=status,
        retry_after=_retry_after(headers, now),
    )


def _meaning(status: int, body: str, key: str | None) -> tuple[ModelErrorKind, bool]:
    """Why, and whether a retry may help."""
    if status in (400, 413, 422) and OVERFLOW.search(body):
        return ModelErrorKind.CONTEXT_OVERFLOW, False
    if status == 401 and key is None:
        return ModelErrorKind.NO_KEY, False
    if status == 429:
        return ModelErrorKind.RATE_LIMITED, not NO_QUOTA.search(body)
    if status in (404, 405) and not _is_json(body):
        return ModelErrorKind.ENDPOINT, False
    if status in (408, 409, 425):
        return ModelErrorKind.REFUSED, True
    if status < 400:
        return ModelErrorKind.ENDPOINT, False
    return (ModelErrorKind.SERVER, True) if status >= 500 else (ModelErrorKind.REFUSED, False)


def _is_json(body: str) -> bool:
    try:
        return isinstance(json.loads(body), dict)
    except (ValueError, RecursionError):
        return False


def _words(body: str) -> str:
    """The message in a JSON error, else the body itself, on one line."""
    words: object = body
    if _is_json(body):
        whole = json.loads(body)
        error = whole.get("error", whole)
        words = error.get("message", error) if isinstance(error, dict) else error
    return " ".join(str(words).split())


def _retry_after(headers: Mapping[str, str], now: float) -> float | None:
    """Seconds, from `Retry-After` (seconds or a date) or OpenAI's `retry-after-ms`."""
    for name, unit in (("retry-after-ms", 0.001), ("retry-after", 1.0)):
        value = headers.get(name, "").strip()
        if re.fullmatch(r"\d{1,9}(\.\d{1,9})?", value):
            return float(value) * unit
    try:
        when = parsedate_to_datetime(headers.get("retry-after", ""))
    except ValueError:
        return None
    return max(0.0, (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp() - now)
