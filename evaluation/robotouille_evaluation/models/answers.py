"""An endpoint's answer, from bytes to text; nothing in them is taken on trust."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from robotouille_evaluation.models.failures import shown, without_secrets
from robotouille_evaluation.models.model import ModelError, ModelErrorKind, Usage
from robotouille_evaluation.models.prices import Prices

__all__ = [
    "MAX_ANSWER_BYTES",
    "MAX_BODY_BYTES",
    "Answer",
    "encodable",
    "read_answer",
    "read_completion",
]

MAX_ANSWER_BYTES = 1_000_000
"""Length of an answer's text in UTF-8; the rest is cut."""
MAX_BODY_BYTES = 16_000_000
"""Length of the whole body; what is longer is not read."""
MAX_TOKENS_COUNTED = 10**9


@dataclass(frozen=True, slots=True)
class Answer:
    """What an endpoint answered in one attempt."""

    text: str
    finish_reason: str
    usage: Usage


def read_answer(
    content_type: str,
    body: bytes,
    prices: Prices | None = None,
    secrets: Sequence[str] = (),
) -> Answer:
    """The answer in a body of status 200.

    Args:
        content_type: Of the body; a stream of events is understood although none is asked for.
        body: All of it.
        prices: Of tokens.
        secrets: Keys, which are struck out wherever they are repeated.

    Raises:
        ModelError: It is no chat completion, broke off, or has no text.
    """
    kind = content_type.partition(";")[0].strip().lower()
    if kind == "text/event-stream":
        whole = _joined(body)
    elif kind.endswith("json"):
        whole = _parsed(body)
    else:
        raise _no_completion(
            f"answers with {shown(kind, *secrets)[:60] or 'no content type'!r} instead of JSON"
        )
    if isinstance(whole.get("error"), dict | str):
        raise _no_completion(f"answers with an error: {shown(whole['error'], *secrets)}")
    return read_completion(whole, prices, secrets)


def read_completion(
    whole: Mapping[str, object], prices: Prices | None = None, secrets: Sequence[str] = ()
) -> Answer:
    """The answer in a chat completion.

    Args:
        whole: The JSON of the completion.
        prices: Of tokens.
        secrets: Keys, which are struck out wherever they are repeated.

    Raises:
        ModelError: It is no chat completion, or has no text.
    """
    usage = _usage(whole.get("usage"), prices)
    choice = _first(whole.get("choices"))
    reason = choice.get("finish_reason")
    reason = shown(reason, *secrets)[:40] if isinstance(reason, str) else ""
    finish_reason = reason or "stop"
    message = _mapping(choice.get("message"))
    text = without_secrets(_text(message.get("content")), secrets)
    if not text.strip():
        raise _no_text(message, finish_reason, usage, secrets)
    cut = _cut(text)
    return Answer(cut, "too-long" if len(cut) < len(text) else finish_reason, usage)


def _cut(text: str) -> str:
    if len(text) * 4 <= MAX_ANSWER_BYTES:
        return text
    return text.encode()[:MAX_ANSWER_BYTES].decode(errors="ignore")


def _no_completion(what: str) -> ModelError:
    return ModelError(ModelErrorKind.ENDPOINT, f"the endpoint {what}", retry_may_help=True)


def _no_text(
    message: Mapping[str, object], finish_reason: str, usage: Usage, secrets: Sequence[str]
) -> ModelError:
    if message.get("tool_calls") or message.get("function_call"):
        what = "a tool call instead of text"
    elif message.get("refusal"):
        what = f"the model declined: {shown(message['refusal'], *secrets)}"
    else:
        what = f"an answer without text (it ended by {finish_reason!r})"
    again = finish_reason in ("stop", "tool_calls")
    return ModelError(ModelErrorKind.EMPTY, what, retry_may_help=again, usage=usage)


def _parsed(text: bytes | str) -> Mapping[str, object]:
    try:
        return _mapping(json.loads(text))
    except (ValueError, RecursionError):
        raise _no_completion("answers with broken JSON") from None


def _mapping(value: object) -> Mapping[str, object]:
    return value if isinstance(value, dict) else {}


def _first(choices: object) -> Mapping[str, object]:
    """The first choice of an answer, or of a piece of a stream."""
    if isinstance(choices, list) and choices and isinstance(choices[0], dict):
        return _mapping(choices[0])
    raise _no_completion("answers with JSON that is no chat completion")


def _text(content: object) -> str:
    """The text of a message: a string, or parts of which some are text."""
    if isinstance(content, list):
        parts = [part.get("text") for part in content if isinstance(part, dict)]
        content = "".join(part for part in parts if isinstance(part, str))
    if not isinstance(content, str):
        return ""
    return encodable(content)


def encodable(text: str) -> str:
    """A text without lone surrogates, which can neither be sent nor written."""
    return text.encode(errors="replace").decode()


def _usage(usage: object, prices: Prices | None) -> Usage:
    counted = _mapping(usage)
    sent, received = _count(counted, "prompt_tokens"), _count(counted, "completion_tokens")
    return Usage(sent, received, prices.cost(sent, received) if prices else None)


def _count(usage: Mapping[str, object], name: str) -> int:
    value = usage.get(name)
    return value if isinstance(value, int) and 0 <= value <= MAX_TOKENS_COUNTED else 0


def _joined(body: bytes) -> Mapping[str, object]:
    """The pieces of a stream as one completion."""
    texts: list[str] = []
    usage, reason, tool_calls, ended = None, None, None, False
    for data in _events(body):
        if data == "[DONE]":
            ended = True
            break
        piece = _parsed(data)
        if isinstance(piece.get("error"), dict | str):
            return piece
        usage = piece.get("usage") or usage
        if not piece.get("choices"):
            continue  # the last piece may have nothing but the usage
        choice = _first(piece["choices"])
        delta = _mapping(choice.get("delta"))
        reason = choice.get("finish_reason") or reason
        tool_calls = delta.get("tool_calls") or tool_calls
        texts.append(_text(delta.get("content")))
    if not (ended or reason):
        raise _no_completion("broke off a stream")
    message = {"content": "".join(texts), "tool_calls": tool_calls}
    return {"choices": [{"message": message, "finish_reason": reason}], "usage": usage}


def _events(body: bytes) -> Iterator[str]:
    for line in body.decode(errors="replace").split("\n"):
        if line.startswith("data:"):
            yield line[5:].strip()
