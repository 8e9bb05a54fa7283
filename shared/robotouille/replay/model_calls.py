"""Calls to language models, recorded in the notes of the seats that the models play.

A note with the topic `model-call` is a JSON object with these fields:

- `number`: number of the call, from 1.
- `known`: how many different messages the seat's earlier calls sent. They are numbered from 0.
- `new`: messages that no earlier call sent, as role and content.
- `sent`: numbers of all messages that this call sent.
- further fields, such as `answer` and `verdict`.

A conversation that grows with each call is thus recorded once.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import indent
from typing import Any

from robotouille.replay.recording import Recording

TOPIC = "model-call"
MAX_MESSAGE, MAX_ANSWER = 50_000, 16_000
"""Characters recorded of a message and of an answer. The number of omitted ones is recorded."""

MAX_CALL, MAX_SEAT = 4_000_000, 100_000_000
"""Characters of messages that are read for one call, and for all calls of a seat. A short note can
claim that a long message was sent a thousand times; longer calls count as not recorded."""

MAX_CALL_NOTE = 8_000_000
"""Characters of a call's note. A longer one counts as not recorded."""

MESSAGE = 20
"""Characters that count for a message besides its text: a call can send a million empty ones."""

# Notes with long texts are split into pieces. This beginning, which `CallNotes` always writes
# first, shows where a call starts after a piece was lost.
BEGIN = '{"number":'


class CallNotes:
    """Writer of one seat's notes."""

    def __init__(self) -> None:
        self._number = 0
        self._known: dict[tuple[str, str], int] = {}

    def note(self, messages: Sequence[tuple[str, str]], **rest: object) -> str:
        """Return the text of the note for one call.

        Args:
            messages: Role and content of all messages sent.
            rest: Further fields, as JSON values.
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
    """One call of a seat's model after a step, with the further fields of its note in `rest`.

    Messages whose note is missing (a lost line, or a used-up quota) have neither role nor content.
    `missed` is the number of calls directly before this one that are not recorded.
    """

    step: int
    player: str
    messages: tuple[Mapping[str, str], ...]
    rest: Mapping[str, Any]
    missed: int = 0

    def row(self) -> dict[str, Any]:
        """Return the call as a row of a transcript: `purpose`, `messages` and further fields."""
        rest = dict(self.rest)
        begin = {"purpose": rest.pop("purpose")} if "purpose" in rest else {}
        return {**begin, "messages": [dict(message) for message in self.messages], **rest}


LOST: Mapping[str, str] = {"role": "", "content": ""}


class _Seat:
    """Reader of one seat's calls."""

    def __init__(self) -> None:
        self.pieces: list[str] = []
        self.size = 0
        self.number = 0
        self.known: dict[int, Mapping[str, str]] = {}
        self.left = MAX_SEAT

    def add(self, piece: str) -> None:
        """Add a piece of a note, unless the note is too long."""
        self.size += len(piece)
        if self.size <= MAX_CALL_NOTE:
            self.pieces.append(piece)
        else:
            self.pieces.clear()

    def read(self, step: int, player: str) -> RecordedCall | None:
        """Return the call in the pieces; None if pieces are missing or belong to something else."""
        row = _object("".join(self.pieces))
        if row is None:
            # The end of an earlier note may have been lost, so start at the last beginning.
            begins = (i for i in reversed(range(len(self.pieces))) if _begins(self.pieces[i]))
            row = _object("".join(self.pieces[next(begins, len(self.pieces)) :]))
        self.pieces.clear()
        self.size = 0
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
        size = sum(MESSAGE + len(message["content"]) for message in messages)
        # The size is checked before texts are joined: the messages of a forged call are references
        # to one text, and only a copy would need the memory.
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
    """Yield the calls of all models, or of one player's model, in order."""
    seats = {each: _Seat() for each in recording.world.players if player in (None, each)}
    for note in recording.notes():
        if note["note"] != "noted" or note["topic"] != TOPIC or note["player"] not in seats:
            continue
        seat = seats[note["player"]]
        seat.add(note["text"])
        if not note.get("more") and (found := seat.read(note["step"], note["player"])) is not None:
            yield found


def call_texts(
    recording: Recording, player: str | None = None, *, as_json: bool = False
) -> Iterator[str]:
    """Yield each call as text for people, or as the JSON line of a transcript."""
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
