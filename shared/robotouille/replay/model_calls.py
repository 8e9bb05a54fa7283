"""What language models were sent and have answered, in the notes of the seats that they play.

A note of the topic `model-call` is a JSON object: `number` from 1 on, `new` with the messages that
this seat has not been sent before, `sent` with the numbers of all that were sent now, and whatever
else belongs to the call (`answer`, `verdict`, …). So a conversation that is sent again and again is
recorded once. `known` is how many messages there were before; they are numbered from 0.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import indent
from typing import Any

from robotouille.replay.recording import Recording

__all__ = [
    "MAX_ANSWER",
    "MAX_MESSAGE",
    "TOPIC",
    "CallNotes",
    "RecordedCall",
    "call_texts",
    "model_calls",
]

TOPIC = "model-call"
MAX_MESSAGE, MAX_ANSWER = 50_000, 16_000
"""Characters that are noted of a message, and of an answer; what was left out is counted."""

MAX_CALL, MAX_SEAT = 4_000_000, 100_000_000
"""Characters that are read of what one call was sent, and all calls of a seat: a short note can say
that a long message was sent a thousand times. What is longer counts as not recorded."""

BEGIN = '{"number":'


class CallNotes:
    """Writes the notes of one seat."""

    def __init__(self) -> None:
        self._number = 0
        self._known: dict[tuple[str, str], int] = {}

    def note(self, messages: Sequence[tuple[str, str]], **rest: object) -> str:
        """The text of the note of one call.

        Args:
            messages: Role and content of all that was sent.
            rest: What else is said of it, as JSON has it.
        """
        self._number += 1
        known = len(self._known)
        sent = [self._known.setdefault(each, len(self._known)) for each in messages]
        new = [[role, _short(text, MAX_MESSAGE)] for role, text in list(self._known)[known:]]
        told = {
            key: _short(value, MAX_ANSWER) if isinstance(value, str) else value
            for key, value in rest.items()
        }
        row = {"number": self._number, "known": known, "new": new, "sent": sent, **told}
        return json.dumps(row, ensure_ascii=False, separators=(",", ":"))


def _short(text: str, longest: int) -> str:
    left_out = len(text) - longest
    return f"{text[:longest]}… [{left_out:,} more characters]" if left_out > 0 else text


@dataclass(frozen=True, slots=True)
class RecordedCall:
    """One call of a seat's model: after which step, the messages sent, and the rest of its note.

    Messages whose note is not in the recording (the line was lost, or the seat's quota was used up)
    have neither role nor content; `missed` calls before this one are not recorded at all.
    """

    step: int
    player: str
    messages: tuple[Mapping[str, str], ...]
    rest: Mapping[str, Any]
    missed: int = 0

    def row(self) -> dict[str, Any]:
        """The same as a line of a transcript: `purpose`, `messages`, and the rest."""
        rest = dict(self.rest)
        begin = {"purpose": rest.pop("purpose")} if "purpose" in rest else {}
        return {**begin, "messages": [dict(message) for message in self.messages], **rest}


LOST: Mapping[str, str] = {"role": "", "content": ""}


class _Seat:
    """What is known of a seat's calls so far."""

    def __init__(self) -> None:
        self.pieces: list[str] = []
        self.number = 0
        self.known: dict[int, Mapping[str, str]] = {}
        self.left = MAX_SEAT

    def read(self, step: int, player: str) -> RecordedCall | None:
        """The call of the pieces; None where some are missing, or they are somebody else's."""
        row = _object("".join(self.pieces))
        if row is None:
            # The end of an earlier note may have been lost: the last one begins behind it.
            begins = (i for i in reversed(range(len(self.pieces))) if _begins(self.pieces[i]))
            row = _object("".join(self.pieces[next(begins, len(self.pieces)) :]))
        self.pieces.clear()
        try:
            return None if row is None else self._call(row, step, player)
        except (ValueError, TypeError, KeyError, OverflowError):
            return None

    def _call(self, row: dict[str, Any], step: int, player: str) -> RecordedCall | None:
        number, first = int(row.pop("number")), int(row.pop("known"))
        new, sent = row.pop("new"), row.pop("sent")
        known = {} if number == 1 else self.known
        told = [{"role": str(role), "content": str(content)} for role, content in new]
        known.update(enumerate(told, start=first))
        self.known, before = known, 0 if number == 1 else self.number
        messages = tuple(known.get(int(i), LOST) for i in sent)
        size = sum(len(message["content"]) for message in messages)
        if size > min(MAX_CALL, self.left):
            return None
        self.left -= size
        self.number = number
        return RecordedCall(step, player, messages, row, max(0, number - before - 1))


def _begins(piece: str) -> bool:
    return piece.startswith(BEGIN)


def _object(text: str) -> dict[str, Any] | None:
    try:
        row = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return row if isinstance(row, dict) else None


def model_calls(recording: Recording, player: str | None = None) -> Iterator[RecordedCall]:
    """The calls of all models in a recording, or of that of one player, in order."""
    seats: dict[str, _Seat] = {}
    for note in recording.notes():
        wanted = note["note"] == "noted" and note["topic"] == TOPIC
        if not wanted or player not in (None, note["player"]):
            continue
        seat = seats.setdefault(note["player"], _Seat())
        seat.pieces.append(note["text"])
        if not note.get("more") and (found := seat.read(note["step"], note["player"])) is not None:
            yield found


def call_texts(
    recording: Recording, player: str | None = None, *, as_json: bool = False
) -> Iterator[str]:
    """Each call for people, or as JSON: the line that a transcript has."""
    before: dict[str, tuple[Mapping[str, str], ...]] = {}
    for call in model_calls(recording, player):
        if as_json:
            yield json.dumps(call.row(), ensure_ascii=False)
        else:
            yield "\n".join(_lines(call, before.get(call.player, ())))
        before[call.player] = call.messages


def _lines(call: RecordedCall, before: Sequence[Mapping[str, str]]) -> Iterator[str]:
    if call.missed:
        yield f"({call.missed} calls before this one are not recorded)"
    same = 0
    for one, other in zip(call.messages, before, strict=False):
        if one != other:
            break
        same += 1
    known = f", {same} of them as before" if same else ""
    yield f"=== step {call.step}: {call.player} was sent {len(call.messages)} messages{known}"
    for message in call.messages[same:]:
        yield f"--- {message['role'] or 'not recorded'}"
        yield indent(message["content"], "    ")
    verdict = call.rest.get("verdict")
    answer = call.rest.get("answer")
    yield f"--- said{f' ({verdict})' if verdict else ''}"
    yield indent(str(answer or ""), "    ") + "\n"
