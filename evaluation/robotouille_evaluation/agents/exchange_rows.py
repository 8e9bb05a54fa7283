"""Exchanges with a model as rows: in transcripts, and in the notes of a recording."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from robotouille.replay.model_calls import CallNotes
from robotouille_evaluation.agents.proposal import Exchange

__all__ = ["exchange_note", "exchange_row"]


def exchange_row(exchange: Exchange) -> dict[str, Any]:
    """What a model was sent and has said, and what was made of it; a line of a transcript."""
    completion = exchange.completion
    return {
        "purpose": exchange.request.purpose,
        "messages": [asdict(message) for message in exchange.request.messages],
        "answer": completion.text if completion is not None else None,
        "seconds": completion.seconds if completion is not None else None,
        "finish_reason": completion.finish_reason if completion is not None else None,
        "verdict": exchange.verdict.value,
        "action": exchange.action,
        "feedback": exchange.feedback,
    }


def exchange_note(notes: CallNotes, exchange: Exchange, *, timed: bool = True) -> str:
    """The same as the text of a note, in which no message stands twice.

    Args:
        timed: With the seconds that the answer took.
    """
    row = exchange_row(exchange)
    if not timed:
        del row["seconds"]
    sent = [(each["role"], each["content"]) for each in row.pop("messages")]
    return notes.note(sent, **row)
