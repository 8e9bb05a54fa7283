"""What happened in an episode, in words, from its recording as far as it is written."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from robotouille.replay.container import MAGIC, frame_ends, frame_value
from robotouille_server.admin.models import Line

__all__ = ["News", "Transcript"]

KEPT = 80
READ = 400
"""So many frames at the end of a long recording are read at first."""
NOTES = {
    "started": "everybody is there, the game begins",
    "resumed": "time runs again",
    "restarted": "the server was restarted and goes on",
}

Sentence = Callable[[list[str]], str]


@dataclass(frozen=True, slots=True)
class News:
    """Frames, and the position in the stream behind them."""

    frames: list[dict[str, Any]]
    end: int


class Transcript:
    """Reads a growing recording from where it was read before. `sentence` words an action."""

    def __init__(self, sentence: Sentence) -> None:
        self.lines: deque[Line] = deque(maxlen=KEPT)
        self._sentence = sentence
        self._position = len(MAGIC)
        self._step = 0

    def read(self, stream: bytes) -> None:
        """Take in what is new of a recording's whole stream so far."""
        self.take(self.news(stream))

    def news(self, stream: bytes) -> News:
        """What is new of a recording's whole stream so far. Nothing is changed: a thread can do
        this, which takes a while where much is new."""
        starts = [self._position, *frame_ends(stream, self._position)]
        end = starts.pop()
        return News([frame_value(stream, start) for start in starts[-READ:]], end)

    def take(self, news: News) -> None:
        """Word what is new; on the event loop, as the actions are the game's."""
        self._position = news.end
        for frame in news.frames:
            self.lines.extend(self._lines(frame))

    def _lines(self, frame: dict[str, Any]) -> Iterator[Line]:
        if frame["kind"] == "step":
            self._step = frame["step"]
            yield from self._acts(frame)
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                if note["note"] != "round_trip":  # The seats show it.
                    yield self._note(note)
        elif frame["kind"] == "footer":
            outcome = frame["outcome"]
            detail = f": {outcome['detail']}" if outcome.get("detail") else ""
            yield self._line("note", "", f"over, {outcome['reason']}{detail}")

    def _acts(self, frame: dict[str, Any]) -> Iterator[Line]:
        unmet = frame.get("unmet", {})
        for number, move in enumerate(frame["moves"]):
            reasons = unmet.get(str(number), [])
            kind = "reject" if reasons else "act"
            yield self._line(kind, move["player"], self._sentence(move["action"]), reasons)

    def _note(self, note: dict[str, Any]) -> Line:
        match note["note"]:
            case "rejected":
                return self._line("reject", note["player"], note["action"], note["reasons"])
            case "said":
                return self._line("say", note["name"], note["text"])
            case "roster":
                return self._line("seat", note["player"], _seat(note))
            case "ready":
                words = "is ready" if note["ready"] else "is not ready"
                return self._line("seat", note["player"], words)
            case "noted":
                return self._line("note", note["player"], f"notes something ({note['topic']})")
            case "announced":
                return self._line("say", "operator", note["text"])
            case "moderated":
                return self._line("note", note["name"], f"was {note['what']}")
            case "countdown":
                begins = f"begins in {note['ms'] / 1000:g} s" if "ms" in note else "waits again"
                return self._line("note", "", f"the game {begins}")
            case "paused":
                return self._line("note", "", f"time stands still ({', '.join(note['holds'])})")
            case other:
                return self._line("note", "", NOTES.get(other, other))

    def _line(self, kind: Any, who: str, text: str, reasons: list[str] | None = None) -> Line:
        return Line(step=self._step, kind=kind, who=who, text=text, reasons=reasons or [])


WHY_FREE = {
    "left": "left, the seat is free",
    "lost": "was away too long, the seat is free",
    "removed": "was removed, the seat is free",
}


def _seat(note: dict[str, Any]) -> str:
    """What a roster note says happened to a seat."""
    name = note["name"]
    if not note.get("taken", True):
        return WHY_FREE.get(note.get("why", ""), "the seat is free")
    if note["present"]:
        return f"{name} is here ({note['kind']})"
    if note.get("controller") == "stand-in":
        return f"{name} is away, a bot stands in"
    return f"{name} is away"
