"""What an endpoint's refusals mean."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import UTC
from email.utils import parsedate_to_datetime

from robotouille_evaluation.models.model import ModelError, ModelErrorKind

__all__ = ["MAX_SHOWN", "refusal", "without_key"]

MAX_SHOWN = 300
"""Characters of an endpoint's words that are shown."""
KEY_LIKE = re.compile(
    r"\b(?:sk|key|pk|gsk|xai)-[\w*.\-]{6,}|Bearer\s+\S+|\S*\*{3}\S*", re.IGNORECASE
)
OVERFLOW = re.compile(
    r"context.?length|context.?window|context.?size|maximum context|prompt is too long"
    r"|input is too long|too many (?:input )?tokens|input tokens exceed",
    re.IGNORECASE,
)
"""How endpoints say that a conversation is too long: OpenAI, vLLM, llama.cpp, Ollama, Anthropic."""
NO_QUOTA = re.compile(r"insufficient_quota|billing|exceeded your current quota", re.IGNORECASE)


def without_key(text: str, key: str | None) -> str:
    """A text in which nothing is left of a key, nor of what looks like one."""
    if key:
        text = text.replace(key, "[key]")
    return KEY_LIKE.sub("[key]", text)


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
    said = without_key(_words(body), key)[:MAX_SHOWN] or "no reason given"
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
