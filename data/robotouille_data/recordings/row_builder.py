"""One recording as rows: its frames go in, rows come out."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from robotouille.episode.rules import Clock
from robotouille.errors import RecordingError
from robotouille.replay.recorder import iso_time
from robotouille_data.recordings.action_words import (
    occupied_predicates,
    player_names,
    workless_actions,
)
from robotouille_data.recordings.certified import fewest_steps
from robotouille_data.recordings.repeats import Repeats
from robotouille_data.recordings.seat import ACTIVITIES, RecordedSeat
from robotouille_data.recordings.steps_left import REACHED, UNKNOWN, StepsLeft

__all__ = ["Row", "RowBuilder"]

Row = tuple[Any, ...]
INT32, INT64 = 2**31 - 1, 2**63 - 1
OF_THEIR_OWN = frozenset({"note", "t", "player", "name", "text", "action"})
"""The fields of a note that are no `details`."""


class RowBuilder:
    """Goes through the frames of one recording, in their order.

    `steps` and `events` are the rows so far; whoever takes them may empty the lists.

    What does not fit what came before (a fact that no table has, a player who has no seat) is a
    LookupError, TypeError, ValueError or AttributeError, in each method; missing steps and numbers
    beyond all bounds are a RecordingError.
    """

    def __init__(self, header: Mapping[str, Any], episode_id: int) -> None:
        self.steps: list[Row] = []
        self.events: list[Row] = []
        self._header = header
        self._id = episode_id
        self._seats = {
            player: RecordedSeat(number, player)
            for number, player in enumerate(player_names(header))
        }
        domain = header["task"]["domain"]
        self._by_turns = header["rules"]["clock"] == Clock.TURN
        self._workless = workless_actions(domain)
        self._occupied = occupied_predicates(domain)
        self._repeats = Repeats(len(header["tables"]["atoms"]))
        self._busy: dict[str, int] = {}
        self._step = self._time = self._number = self._blocking = 0
        self._begun = False
        self._outcome: Mapping[str, Any] | None = None

    def add(self, frame: dict[str, Any]) -> None:
        """The next frame behind the header."""
        match frame["kind"]:
            case "step":
                self._take(frame)
            case "notes":
                for note in frame["notes"]:
                    self._note(note)
            case "state" if frame["step"] == 0:
                self._busy = frame["busy"]
                self._repeats.begin(frame)
            case "footer":
                self._outcome = frame["outcome"]

    def _take(self, frame: dict[str, Any]) -> None:
        number, time = frame["step"], _bounded(frame["t"])
        if number != self._step + 1:
            raise RecordingError(f"step {self._step + 1} is missing")
        moves = self._moves(frame)
        turn = self._step % len(self._seats) if self._by_turns else None
        busy, waits = self._busy, frame.get("waits", ())
        for player, seat in self._seats.items():
            move = moves.get(player)
            applied = None if move is None else move[2]
            others_turn = turn is not None and turn != seat.number
            seat.refused = seat.refused or player in waits
            did = seat.activity(applied, busy.get(player, 0) > 0, others_turn)
            told = (None, None, None, None, None) if move is None else move
            self.steps.append(
                (self._id, number, seat.number, time, did, seat.controller._value_, *told)
            )
            seat.refused = False
            if applied is not False:
                self._blocking += seat.blocked
            seat.blocked = 0
        self._busy = frame.get("busy", busy)
        actions = tuple(
            (m["player"], *m["action"]) for m in frame["moves"] if moves[m["player"]][2]
        )
        self._repeats.step(frame, actions, self._busy)
        self._step, self._time = number, time

    def _moves(self, frame: Mapping[str, Any]) -> dict[str, Row]:
        """Who did what in a step: action, arguments, applied, ms, staleness."""
        unmet = frame.get("unmet", {})
        found = {}
        for place, move in enumerate(frame["moves"]):
            seat = self._seats[move["player"]]
            name, *arguments = move["action"]
            applied = str(place) not in unmet
            milliseconds, basis = _bounded(move["ms"]), move.get("basis")
            stale = None if basis is None else _bounded(self._step - basis, INT32)
            if move["seq"] > 0:
                seat.thinking += milliseconds
                seat.lost += not applied
                seat.rejected += not applied
                if stale is not None:
                    seat.based += 1
                    seat.stale += stale
            if applied:
                seat.work += name not in self._workless
            else:
                self._blocking += 1
            words = _clean(" ".join(arguments))
            found[move["player"]] = _clean(name), words, applied, milliseconds, stale
        return found

    def _note(self, note: dict[str, Any]) -> None:
        seat = self._seats.get(note.get("player", ""))
        match note["note"]:
            case "roster" if seat:
                seat.sit(note)
            case "rejected" if seat:
                seat.refuse(note, self._occupied)
            case "said" if seat:
                seat.said += 1
            case "started":
                self._begun = True
                for each in self._seats.values():
                    each.refused = False
        details = {key: value for key, value in note.items() if key not in OF_THEIR_OWN}
        text = note.get("text") or note.get("action", "")
        self.events.append((
            self._id, self._number, self._step, _bounded(note["t"]), note["note"],
            None if seat is None else seat.number, _clean(note.get("name", "")), _clean(text),
            _json(details),
        ))  # fmt: skip
        self._number += 1

    # The end

    def episode(self) -> Row:
        """The row of the episode itself."""
        header, rules, end = self._header, self._header["rules"], self._outcome
        if end is not None and end["steps"] != self._step:
            raise RecordingError(f"there are {self._step} steps, its end speaks of {end['steps']}")
        real_time = rules["clock"] == Clock.REALTIME
        return (
            self._id,
            _clean(header["episode"]),
            "unfinished" if end is None else "ended",
            _clean(iso_time(header["created"])),
            _clean(header["software"]),
            _clean(header["task"]["name"]),
            _clean(header["digest"]),
            _clean(header["task"]["timing"]),
            _bounded(header["seed"]),
            _clean(rules["clock"]),
            _finite(rules["step_rate"]) if real_time and "step_rate" in rules else None,
            _bounded(rules["max_steps"], INT32),
            _clean(str(rules.get("absence", ""))),
            len(self._seats),
            None if end is None else _clean(end["reason"]),
            None if end is None else _clean(end.get("detail", "")),
            self._step,
            self._seconds(end),
            _clean(header.get("code", "")),
            _clean(header.get("owner", "")),
        )

    def _seconds(self, end: Mapping[str, Any] | None) -> float:
        """How long it took. Earlier versions recorded when it ended, on the server's clock, where
        it had never begun."""
        if end is None:
            return self._time / 1000
        return _finite(end["seconds"]) if self._begun or self._step else 0.0

    def seats(self) -> list[Row]:
        """The rows of the seats, in order."""
        work = sum(seat.work for seat in self._seats.values())
        treatments = self._header.get("treatments", {})
        return [
            (
                self._id,
                seat.number,
                _clean(seat.player),
                _clean(seat.name),
                _clean(seat.kind),
                _clean(seat.participant),
                *(seat.did[each] for each in ACTIVITIES),
                seat.lost,
                seat.invalid,
                seat.malformed,
                seat.rejected,
                seat.said,
                _bounded(seat.thinking),
                seat.stale / seat.based if seat.based else None,
                seat.work / work if work else 0.0,
                _clean(treated.get("shown_as") or ""),
                _bounded(treated.get("delay_ms", 0), INT32),
            )
            for seat in self._seats.values()
            for treated in [treatments.get(seat.player, {})]
        ]

    def labels(self) -> list[Row]:
        """The rows of the header's labels."""
        labels = self._header.get("labels") or {}
        cleaned = {_clean(name): _clean(value) for name, value in labels.items()}
        return [(self._id, name, value) for name, value in sorted(cleaned.items())]

    @property
    def success(self) -> bool | None:
        """Whether the goal was reached; None while that is open."""
        return None if self._outcome is None else self._outcome["reason"] == "goal"

    def measures(self, left: StepsLeft = UNKNOWN) -> Row:
        """The row of the team's measures.

        Args:
            left: How far from the goal it ended, if it did not reach it.
        """
        success = self.success
        fewest = fewest_steps(self._header["task"])
        rate = self._step / fewest if success and fewest else None
        blocking = self._blocking + sum(seat.blocked for seat in self._seats.values())
        left = REACHED if success else left
        return self._id, success, fewest, rate, self._repeats.count, blocking, *left


def _bounded(number: int, limit: int = INT64) -> int:
    """A number that a column can hold."""
    if not -limit <= number <= limit:
        raise RecordingError(f"a number beyond all bounds: {number}")
    return number


def _finite(number: float) -> float:
    """A number that both databases hold alike."""
    if not math.isfinite(found := float(number)):
        raise RecordingError(f"a number beyond all bounds: {found}")
    return found


def _clean(text: str) -> str:
    """A text without the one character that PostgreSQL cannot hold, so that both hold the same."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}") if "\0" in text else text


def _json(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    return text.replace("\\u0000", "\N{REPLACEMENT CHARACTER}") if "\\u0000" in text else text
