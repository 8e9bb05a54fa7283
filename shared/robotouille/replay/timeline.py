"""Pauses, controllers and notes of a recording, as data and as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple, Protocol

from robotouille.replay.controllers import Span, spans
from robotouille.replay.frame_schema import MAX_HOLDS
from robotouille.replay.recording import Recording

MAX_SHOWN = 200
"""Characters of a seat's note that a list shows."""
# `holds` is the field's name in recordings of format 2; the code calls them reasons for pauses.
HOLDS = {
    "operator": "by the operator",
    "player": "by the player",
    "storage": "the recording could not be written",
    "restart": "the server was restarted",
    "absence": "a player was away",
    "deserted": "everybody was away",
}


class NoteSource(Protocol):
    """Source of notes, such as a `Recording`."""

    @property
    def outcome(self) -> dict[str, Any] | None:
        """The outcome; None if the end is not recorded."""
        ...

    def notes(self) -> Iterator[dict[str, Any]]:
        """Yield the notes in order, each with the number of the step before it as `step`."""
        ...


@dataclass(frozen=True, slots=True)
class Stillness:
    """A pause after `step`, from `t` milliseconds, for the reasons `holds`.

    `seconds` is None if the recording does not contain the end of the pause.
    """

    step: int
    t: int
    holds: tuple[str, ...]
    seconds: float | None


def pauses(recording: NoteSource) -> list[Stillness]:
    """Return the pauses in order."""
    found: list[Stillness] = []
    begun: tuple[int, int] | None = None
    # A dictionary, because joining tuples would take hours for the notes of a hostile recording,
    # which can also name other reasons again and again.
    holds: dict[str, None] = {}
    for note in recording.notes():
        if note["note"] == "paused":
            begun = begun or (note["step"], note["t"])
            if len(holds) < MAX_HOLDS:
                holds.update(dict.fromkeys(note["holds"]))
        elif note["note"] in ("resumed", "restarted") and begun is not None:
            found.append(_ended(Stillness(*begun, tuple(holds), None), note["t"]))
            begun, holds = None, {}
    if begun is not None:
        still, outcome = Stillness(*begun, tuple(holds), None), recording.outcome
        found.append(still if outcome is None else _ended(still, round(outcome["seconds"] * 1000)))
    return found


def _ended(still: Stillness, t: int) -> Stillness:
    return replace(still, seconds=max(0, t - still.t) / 1000)


def course(recording: Recording) -> dict[str, Any]:
    """Return the controllers, the pauses and the steps before server restarts, as plain data."""
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
    """Yield the course as pairs of heading and text. Further lines have an empty heading."""
    moved = [
        f"{player}: {', '.join(map(_span_words, course))}"
        for player, course in spans(recording).items()
        if course
    ]
    still = [_pause_words(pause) for pause in pauses(recording)]
    restarts = [
        f"after step {note['step']}" for note in recording.notes() if note["note"] == "restarted"
    ]
    for heading, lines in (("played by", moved), ("paused", still), ("restarted", restarts)):
        for i, line in enumerate(lines):
            yield "" if i else heading, line


def _span_words(span: Span) -> str:
    steps = f"step {span.first}" if span.first == span.last else f"steps {span.first}-{span.last}"
    match span.controller:
        case "":
            who = "nobody"
        case "absent":
            who = f"nobody ({span.name} was away)"
        case "substitute":
            who = f"a substitute for {span.name}" if span.name else "a substitute"
        case _:
            who = f"{span.name} ({span.controller})"
    return f"{who} in {steps}"


def _pause_words(pause: Stillness) -> str:
    why = _reasons(pause.holds)
    return f"after step {pause.step} {_length(pause)}: {why}"


def _length(pause: Stillness) -> str:
    return "until the file ends" if pause.seconds is None else f"for {pause.seconds:g} s"


def _interlude_words(pause: Stillness) -> str:
    # Viewers see whole seconds, and no reason for the player's own pause.
    seconds = None if pause.seconds is None else max(1, round(pause.seconds))
    words = f"Paused {_length(replace(pause, seconds=seconds))}"
    return words if pause.holds == ("player",) else f"{words}: {_reasons(pause.holds)}"


def _reasons(holds: Sequence[str]) -> str:
    # After a restart nobody has come back yet, which needs no mention.
    told = [hold for hold in holds if hold != "deserted" or "restart" not in holds]
    return " and ".join(HOLDS.get(hold, hold) for hold in told)


class Interlude(NamedTuple):
    """Text that a viewer shows after a step, until the game goes on unless it `lasts`."""

    step: int
    words: str
    lasts: bool = True


def interludes(recording: NoteSource) -> list[Interlude]:
    """Return the texts that a viewer shows between steps, in order."""
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
    "left": "leaves",
    "lost": "was away too long and lost",
    "removed": "was removed by the operator from",
}


def note_lines(recording: Recording) -> Iterator[str]:
    """Yield a line for each note: the step before it, the seconds since the start, and its text."""
    seated: dict[str, tuple[str, str]] = {}
    for note in recording.notes():
        words = note_words(note, seated)
        yield f"{note['step']:5}  {note['t'] / 1000:9.3f} s  {words}"


def note_words(note: Mapping[str, Any], seated: dict[str, tuple[str, str]]) -> str:
    """Return a note as text. `seated` has the name and session of each seat, and is updated."""
    return _roster_words(note, seated) if note["note"] == "roster" else _note_words(note)


def _roster_words(note: Mapping[str, Any], seated: dict[str, tuple[str, str]]) -> str:
    player, name, session = note["player"], note["name"], note.get("session", "")
    before = seated.get(player)
    controller = note.get("controller", "")
    by_bot = ", a substitute plays" if controller == "substitute" else ""
    if not note["taken"] or not name:
        seated.pop(player, None)
        who = before[0] if before else "nobody"
        does = DEPARTURES.get(note.get("why", ""), "leaves")
        return f"{who} {does} {player}{by_bot}" if before else f"{player} is free{by_bot}"
    seated[player] = (name, session)
    if not note["present"]:
        return f"{name} ({player}) is away{by_bot}"
    # A participant may come back in a new session.
    if before is None or (before[0] != name and before[1] != session):
        return f"{name} ({note['kind']}) takes {player}"
    return f"{name} ({player}) is back"


def _countdown(note: Mapping[str, Any]) -> str:
    if "ms" not in note:
        return "the countdown stops: a player is missing or not ready"
    return f"all players are ready: the game starts in {note['ms'] / 1000:g} s"


def _note_words(note: Mapping[str, Any]) -> str:
    match note["note"]:
        case "countdown":
            return _countdown(note)
        case "ready":
            return f"{note['player']} is {'' if note['ready'] else 'not '}ready"
        case "started":
            return "the game starts"
        case "rejected":
            return f"{note['player']}: {note['action']} was rejected: {'; '.join(note['reasons'])}"
        case "said":
            return f"{note['name']}: {note['text']}"
        case "noted":
            dots = "…" if note.get("more") or len(note["text"]) > MAX_SHOWN else ""
            return f"{note['player']} notes ({note['topic']}): {note['text'][:MAX_SHOWN]}{dots}"
        case "round_trip":
            return f"{note['player']}: round-trip time {note['ms']:g} ms"
        case "announced":
            return f"the operator: {note['text']}"
        case "moderated":
            return f"{note['name']} was {note['what']} by the operator"
        case "paused":
            return f"paused: {_reasons(note['holds'])}"
        case "resumed":
            return "the game resumes"
        case "restarted":
            return "the server was restarted"
    return str(note["note"])
