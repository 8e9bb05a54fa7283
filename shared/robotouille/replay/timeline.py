"""What happened in a recording besides its steps, as data and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple, Protocol

from robotouille.replay.controllers import Span, spans
from robotouille.replay.recording import Recording

__all__ = [
    "Interlude",
    "NoteSource",
    "Stillness",
    "course",
    "course_text",
    "interludes",
    "note_lines",
    "note_words",
    "pauses",
]

MAX_SHOWN = 200
"""Characters of a seat's note that are shown in a list."""
HOLDS = {
    "operator": "by the operator",
    "player": "by the player",
    "storage": "the recording could not be written",
    "restart": "the server was restarted",
    "absence": "somebody was away",
    "deserted": "everybody was away",
}


class NoteSource(Protocol):
    """What has notes: a `Recording`, or what was kept of one."""

    @property
    def outcome(self) -> dict[str, Any] | None:
        """How it ended; None if it has no end."""
        ...

    def notes(self) -> Iterator[dict[str, Any]]:
        """The notes in order, each with the `step` that it came after."""
        ...


@dataclass(frozen=True, slots=True)
class Stillness:
    """A time in which the game stood still, after `step` and from `t` milliseconds on. `holds` are
    all the reasons it had, `seconds` is None where the recording does not say until when."""

    step: int
    t: int
    holds: tuple[str, ...]
    seconds: float | None


def pauses(recording: NoteSource) -> list[Stillness]:
    """The times in which the game stood still, in order."""
    found: list[Stillness] = []
    for note in recording.notes():
        still = found[-1] if found and found[-1].seconds is None else None
        if note["note"] == "paused" and still is None:
            found.append(Stillness(note["step"], note["t"], tuple(note["holds"]), None))
        elif note["note"] == "paused" and still is not None:
            holds = tuple(dict.fromkeys((*still.holds, *note["holds"])))
            found[-1] = replace(still, holds=holds)
        elif note["note"] in ("resumed", "restarted") and still is not None:
            found[-1] = _ended(still, note["t"])
    if found and found[-1].seconds is None and recording.outcome is not None:
        found[-1] = _ended(found[-1], round(recording.outcome["seconds"] * 1000))
    return found


def _ended(still: Stillness, t: int) -> Stillness:
    return replace(still, seconds=max(0, t - still.t) / 1000)


def course(recording: Recording) -> dict[str, Any]:
    """Who moved which seat in which steps, pauses, and the steps after which another process of
    the server went on."""
    return {
        "controllers": {
            player: [
                {key: value for key, value in asdict(span).items() if key != "player"}
                for span in course
            ]
            for player, course in spans(recording).items()
        },
        "pauses": [asdict(pause) for pause in pauses(recording)],
        "restarts": [n["step"] for n in recording.notes() if n["note"] == "restarted"],
    }


def course_text(recording: Recording) -> Iterator[tuple[str, str]]:
    """The same as lines of (heading, text); the heading of further lines is empty."""
    moved = [
        f"{player}: {', '.join(map(_span_words, course))}"
        for player, course in spans(recording).items()
        if course
    ]
    still = [_pause_words(pause) for pause in pauses(recording)]
    begun_anew = [
        f"after step {note['step']}" for note in recording.notes() if note["note"] == "restarted"
    ]
    for heading, lines in (("moved by", moved), ("paused", still), ("restarted", begun_anew)):
        for i, line in enumerate(lines):
            yield "" if i else heading, line


def _span_words(span: Span) -> str:
    steps = f"step {span.first}" if span.first == span.last else f"steps {span.first}-{span.last}"
    match span.controller:
        case "":
            who = "nobody"
        case "absent":
            who = f"nobody ({span.name} was away)"
        case "stand-in":
            who = f"a stand-in for {span.name}" if span.name else "a stand-in"
        case _:
            who = f"{span.name} ({span.controller})"
    return f"{who} in {steps}"


def _pause_words(pause: Stillness) -> str:
    why = _reasons(pause.holds)
    return f"after step {pause.step} {_length(pause)}: {why}"


def _length(pause: Stillness) -> str:
    return "until the file ends" if pause.seconds is None else f"for {pause.seconds:g} s"


def _interlude_words(pause: Stillness) -> str:
    """A pause as it is told to who watches: whole seconds, and no reason where it goes without
    saying."""
    seconds = None if pause.seconds is None else max(1, round(pause.seconds))
    words = f"Paused {_length(replace(pause, seconds=seconds))}"
    return words if pause.holds == ("player",) else f"{words}: {_reasons(pause.holds)}"


def _reasons(holds: Sequence[str]) -> str:
    """Reasons in words; after a restart it goes without saying that nobody is there yet."""
    told = [hold for hold in holds if hold != "deserted" or "restart" not in holds]
    return " and ".join(HOLDS.get(hold, hold) for hold in told)


class Interlude(NamedTuple):
    """What somebody who watches should be told after a step; one that does not last is over as soon
    as the game goes on."""

    step: int
    words: str
    lasts: bool = True


def interludes(recording: NoteSource) -> list[Interlude]:
    """What somebody who watches the recording should be told."""
    still = [
        (pause.t, Interlude(pause.step, _interlude_words(pause), lasts=False))
        for pause in pauses(recording)
    ]
    said = [
        (note["t"], Interlude(note["step"], f"The operator: {note['text']}"))
        for note in recording.notes()
        if note["note"] == "announced"
    ]
    return [told for _, told in sorted(still + said)]


DEPARTURES = {
    "left": "gives up",
    "lost": "was away too long and loses",
    "removed": "is removed by the operator from",
}


def note_lines(recording: Recording) -> Iterator[str]:
    """A line for each note: the step it came after, the seconds since the game began, words."""
    seated: dict[str, tuple[str, str]] = {}
    for note in recording.notes():
        words = note_words(note, seated)
        yield f"{note['step']:5}  {note['t'] / 1000:9.3f} s  {words}"


def note_words(note: Mapping[str, Any], seated: dict[str, tuple[str, str]]) -> str:
    """What a note says; `seated` are name and session of each seat so far, kept up to date here."""
    return _roster_words(note, seated) if note["note"] == "roster" else _note_words(note)


def _roster_words(note: Mapping[str, Any], seated: dict[str, tuple[str, str]]) -> str:
    """What a roster note changes."""
    player, name, session = note["player"], note["name"], note.get("session", "")
    before = seated.get(player)
    controller = note.get("controller", "")
    by_bot = ", a stand-in plays" if controller == "stand-in" else ""
    if not note.get("taken", True) or not name:
        seated.pop(player, None)
        who = before[0] if before else "nobody"
        does = DEPARTURES.get(note.get("why", ""), "gives up")
        return f"{who} {does} {player}{by_bot}" if before else f"{player} is free{by_bot}"
    seated[player] = (name, session)
    if not note["present"]:
        return f"{name} ({player}) is away{by_bot}"
    if before is None or (before != (name, session) and before[1] != session):
        return f"{name} ({note['kind']}) takes {player}"
    return f"{name} ({player}) is back"


def _countdown(note: Mapping[str, Any]) -> str:
    if "ms" not in note:
        return "somebody is missing: the game does not begin yet"
    return f"everybody is there: the game begins in {note['ms'] / 1000:g} s"


def _note_words(note: Mapping[str, Any]) -> str:
    match note["note"]:
        case "countdown":
            return _countdown(note)
        case "ready":
            return f"{note['player']} is {'' if note['ready'] else 'not '}ready"
        case "started":
            return "the game begins"
        case "rejected":
            return f"{note['player']}: {note['action']} is rejected: {'; '.join(note['reasons'])}"
        case "said":
            return f"{note['name']}: {note['text']}"
        case "noted":
            dots = "…" if note.get("more") or len(note["text"]) > MAX_SHOWN else ""
            return f"{note['player']} notes ({note['topic']}): {note['text'][:MAX_SHOWN]}{dots}"
        case "round_trip":
            return f"{note['player']}: {note['ms']:g} ms to its participant and back"
        case "announced":
            return f"the operator: {note['text']}"
        case "moderated":
            return f"{note['name']} is {note['what']} by the operator"
        case "paused":
            return f"paused: {_reasons(note['holds'])}"
        case "resumed":
            return "the game goes on"
        case "restarted":
            return "the server was restarted"
    return str(note["note"])
