"""Rows of the catalogue from the frames of a recording."""

from __future__ import annotations

import hashlib
import json
import math
import stat
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import sqlalchemy as sa

from robotouille.domain.schema import Shift
from robotouille.domain.task import PROFILES
from robotouille.episode.lifecycle import Stopwatch
from robotouille.episode.rules import Clock
from robotouille.errors import RecordingError
from robotouille.replay.compression import is_closed, plain
from robotouille.replay.container import MAX_FILE, frames_with_ends
from robotouille.replay.file_names import iso_time, iso_time_of
from robotouille.replay.frame_schema import check_frame
from robotouille_data.recorded_seats import (
    ACTIVITIES,
    REACHED,
    UNKNOWN,
    RecordedSeat,
    Repeats,
    StepsLeft,
    fewest_steps,
    occupied_predicates,
    player_names,
    steps_left,
    useful_steps,
    workless_actions,
)
from robotouille_data.schema import EPISODES, EVENTS, LABELS, MEASURES, SEATS, STEPS

Row = tuple[Any, ...]
TableRows = tuple[sa.Table, Sequence[Row]]


class Part(NamedTuple):
    """Rows of several tables, and the bytes of memory that they take at most."""

    tables: list[TableRows]
    size: int


INT32, INT64 = 2**31 - 1, 2**63 - 1
# The rows of a hostile recording would fill the disk: each step has a row for each seat.
MAX_SEATS, MAX_STEP_ROWS = 64, 20_000_000
"""Seats of a recording, and rows of its steps."""
OF_THEIR_OWN = frozenset({"note", "t", "player", "name", "text", "action"})
"""Fields of a note that have columns of their own. All others go into `details`."""


class RowBuilder:
    """Builder that turns the frames of one recording into rows.

    Rows of steps and events come first: the caller takes them with `take_rows` whenever it likes.

    If a frame contradicts an earlier one, such as a fact without a table entry or a player without
    a seat, any method may raise LookupError, TypeError, ValueError or AttributeError. Missing steps
    and numbers out of range raise RecordingError.

    Args:
        useful: The result of `useful_steps`; None if it was not computed.
    """

    def __init__(
        self,
        header: Mapping[str, Any],
        episode_id: int,
        useful: Sequence[Collection[str]] | None = None,
    ) -> None:
        self._steps: list[Row] = []
        self._events: list[Row] = []
        self._text = 0  # In bytes of memory.
        self._header = header
        self._id = episode_id
        self._useful = useful
        players = player_names(header)
        if len(players) > MAX_SEATS:
            raise RecordingError(f"{len(players):,} seats; a catalogue has at most {MAX_SEATS}")
        self._seats = {
            player: RecordedSeat(number, player) for number, player in enumerate(players)
        }
        domain, shift = header["task"]["domain"], header["task"]["problem"].get("shift")
        self._shift = None if shift is None else Shift.model_validate(shift)
        self._by_turns = header["rules"]["clock"] == Clock.TURN
        self._workless = workless_actions(domain)
        self._occupied = occupied_predicates(domain)
        self._repeats = Repeats(len(header["tables"]["atoms"]))
        self._busy: dict[str, int] = {}
        self._step = self._time = self._number = self._blocking = 0
        self._outcome: Mapping[str, Any] | None = None
        self._running = Stopwatch()
        # In milliseconds since 1970; 0 if unknown.
        self._started = self._ended = 0

    # Frames are read without simulating the game: the recorded changes are enough for all rows.
    def add(self, frame: dict[str, Any]) -> None:
        """Add the next frame after the header."""
        match frame["kind"]:
            case "step":
                self._take(frame)
            case "notes":
                for note in frame["notes"]:
                    self._note(note)
            # Later states are checkpoints for seeking, and contain nothing that the steps lack.
            case "state" if frame["step"] == 0:
                self._busy = frame["busy"]
                self._repeats.begin(frame)
            case "footer":
                self._outcome = frame["outcome"]
                self._ended = frame.get("utc_ms", 0)

    def _take(self, frame: dict[str, Any]) -> None:
        number, time = frame["step"], _bounded(frame["t"])
        # A gap would shift activities and staleness without any visible error.
        if number != self._step + 1:
            raise RecordingError(f"step {self._step + 1} is missing")
        if number * len(self._seats) > MAX_STEP_ROWS:
            raise RecordingError(f"more than {MAX_STEP_ROWS:,} rows of steps")
        moves = self._moves(frame)
        turn = self._step % len(self._seats) if self._by_turns else None
        busy, waits = self._busy, frozenset(frame.get("waits", ()))
        late = _bounded(frame.get("late", 0))
        useful = None if self._useful is None else self._useful[self._step]
        for player, seat in self._seats.items():
            move = moves.get(player)
            applied = None if move is None else move[2]
            others_turn = turn is not None and turn != seat.number
            # `waits` lists the players who declared that they wait instead of acting.
            declared = player in waits
            seat.waits += declared
            seat.refused = seat.refused or declared
            did = seat.activity(applied, busy.get(player, 0) > 0, others_turn)
            action = (None, None, None, None, None) if move is None else move
            could = None if useful is None else seat.judge(did, useful)
            self._steps.append((
                self._id, number, seat.number, time, late, did, declared, could,
                seat.controller._value_, *action,
            ))  # fmt: skip
            seat.refused = False
            # A rejected move already counts as blocking in `_moves`; do not count its step twice.
            if applied is not False:
                self._blocking += seat.blocked
            seat.blocked = 0
        self._busy = frame.get("busy", busy)
        actions = tuple(
            (m["player"], *m["action"]) for m in frame["moves"] if moves[m["player"]][2]
        )
        self._repeats.step(frame, actions)
        self._step, self._time = number, time

    def _moves(self, frame: Mapping[str, Any]) -> dict[str, Row]:
        """Return the action, arguments, applied, ms and staleness of each player in a step."""
        unmet = frame.get("unmet", {})
        found = {}
        for place, move in enumerate(frame["moves"]):
            seat = self._seats[move["player"]]
            name, *arguments = move["action"]
            # The acting player is the first argument of an action that has one. Re-simulation
            # refuses a move of another seat, too (`Recording.actions`).
            if arguments and arguments[0] in self._seats and arguments[0] != seat.player:
                action = f"{name}({', '.join(arguments)})"
                raise RecordingError(
                    f"step {frame['step']}: {action} is not an action of {seat.player!r}"
                )
            applied = str(place) not in unmet
            milliseconds, basis = _bounded(move["ms"]), move.get("basis")
            stale = None if basis is None else _bounded(self._step - basis, INT32)
            # Moves of a substitute have number 0. Their times say nothing about the participant.
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
            texts = _clean(name), _clean(" ".join(arguments))
            self._text += sum(map(_memory, texts))
            found[move["player"]] = *texts, applied, milliseconds, stale
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
            case "paused":
                self._running.stop(note["t"] / 1000)
            case "resumed" | "restarted":
                self._running.go_on(note["t"] / 1000)
            case "started":
                self._started = note.get("utc_ms", 0)
                # Requests before the start belong to no step: the first step must not count them.
                for each in self._seats.values():
                    each.refused = False
        details = {key: value for key, value in note.items() if key not in OF_THEIR_OWN}
        name, text = _clean(note.get("name", "")), note.get("text") or note.get("action", "")
        texts = name, _clean(text), _json(details)
        self._events.append((
            self._id, self._number, self._step, _bounded(note["t"]), note["note"],
            None if seat is None else seat.number, *texts,
        ))  # fmt: skip
        self._text += sum(map(_memory, texts))
        self._number += 1

    def full(self) -> bool:
        """Return whether the rows so far should be taken."""
        return len(self._steps) + len(self._events) >= MAX_ROWS or self._text >= MAX_TEXT

    def take_rows(self) -> Part:
        """Return the rows of steps and events so far, and forget them."""
        size = (len(self._steps) + len(self._events)) * ROW_BYTES + self._text
        taken = Part([(STEPS, self._steps), (EVENTS, self._events)], size)
        self._steps, self._events, self._text = [], [], 0
        return taken

    # The end

    def episode(self) -> Row:
        """Return the row of the episode."""
        header, rules, end = self._header, self._header["rules"], self._outcome
        # A footer with another number of steps means that frames were lost or the file was edited.
        if end is not None and end["steps"] != self._step:
            raise RecordingError(f"{self._step} steps recorded, but the footer has {end['steps']}")
        real_time = rules["clock"] == Clock.REALTIME
        seconds = self._time / 1000 if end is None else _finite(end["seconds"])
        grace = rules.get("grace")
        return (
            self._id,
            _clean(header["episode"]),
            "unfinished" if end is None else "ended",
            _clean(iso_time(header["created"])),
            iso_time_of(self._started) if self._started else None,
            iso_time_of(self._ended) if self._ended else None,
            _clean(header["software"]),
            _clean(header["task"]["name"]),
            _clean(header["digest"]),
            _clean(header["task"]["timing"]),
            _bounded(header["seed"]),
            _clean(rules["clock"]),
            _finite(rules["step_rate"]) if real_time and "step_rate" in rules else None,
            _bounded(rules["max_steps"], INT32),
            _clean(str(rules.get("absence", ""))),
            None if grace is None else _finite(grace),
            _clean(str(rules.get("chat", "free"))),
            _json(list(rules.get("phrases", ()))),
            len(self._seats),
            None if end is None else _clean(end["reason"]),
            None if end is None else _clean(end.get("detail", "")),
            self._step,
            seconds,
            _finite(self._running.read(seconds)),
            _clean(header.get("code", "")),
            _clean(header.get("owner", "")),
        )

    def seats(self) -> list[Row]:
        """Return the rows of the seats in order."""
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
                seat.waits,
                *((None, None) if self._useful is None else (seat.unused, seat.hindered)),
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
                _clean(seat.agent),
            )
            for seat in self._seats.values()
            for treated in [treatments.get(seat.player, {})]
        ]

    def labels(self) -> list[Row]:
        """Return the rows of the header's labels."""
        labels = self._header.get("labels") or {}
        cleaned = {_clean(name): _clean(value) for name, value in labels.items()}
        return [(self._id, name, value) for name, value in sorted(cleaned.items())]

    @property
    def success(self) -> bool | None:
        """True if the goal was reached; None for an unfinished episode, and for a shift."""
        if self._outcome is None or self._shift is not None:
            return None
        return bool(self._outcome["reason"] == "goal")

    def measures(self, left: StepsLeft = UNKNOWN) -> Row:
        """Return the row of the team's measures.

        Args:
            left: Steps to go of a failed episode.
        """
        success = self.success
        fewest = fewest_steps(self._header["task"])
        rate = self._step / fewest if success and fewest else None
        blocking = self._blocking + sum(seat.blocked for seat in self._seats.values())
        left = REACHED if success else left
        return self._id, success, fewest, rate, self._repeats.count, blocking, *left, *self._score()

    def _score(self) -> Row:
        """Return the points, served and expired orders of a shift, and the bound on the points."""
        if self._shift is None:
            return None, None, None, None
        bound = self._shift.bound(PROFILES[self._header["task"]["timing"]].delay_factor)
        score = None if self._outcome is None else self._outcome["score"]
        found = [None if score is None else score[n] for n in ("points", "served", "expired")]
        return (*(None if each is None else _bounded(each, INT32) for each in (*found, bound)),)


def _bounded(number: int, limit: int = INT64) -> int:
    """Check that a column can hold the number."""
    if not -limit <= number <= limit:
        raise RecordingError(f"number out of range: {number}")
    return number


def _finite(number: float) -> float:
    """Check that the number is finite. SQLite stores NaN as null, PostgreSQL does not."""
    if not math.isfinite(found := float(number)):
        raise RecordingError(f"number out of range: {found}")
    return found


def _clean(text: str) -> str:
    """Replace NUL, which PostgreSQL cannot store, so that both databases have equal rows."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}") if "\0" in text else text


def _memory(text: str) -> int:
    """Return the bytes of memory that a text takes at most while it is stored."""
    # Python takes up to four bytes for a character, and SQLite's driver adds its UTF-8.
    return len(text) if text.isascii() else 8 * len(text)


def _json(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    return text.replace("\\u0000", "\N{REPLACEMENT CHARACTER}") if "\\u0000" in text else text


MAX_ROWS, MAX_TEXT = 100_000, 16 * 1024 * 1024
"""Maximum number of rows in memory, and of bytes of their texts. The rows of a longer
recording come in several parts."""
ROW_BYTES = 300
"""Memory of a row without its long texts."""


def read_content(path: Path) -> bytes:
    """Return the bytes of a file.

    Raises:
        RecordingError: The file is too large for a recording, or not a regular file. Reading a
            pipe might never end.
        OSError: The file cannot be read now.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise RecordingError("not a regular file")
    with path.open("rb") as file:
        content = file.read(MAX_FILE + 1)
    if len(content) > MAX_FILE:
        raise RecordingError(f"larger than {MAX_FILE:,} bytes")
    return content


def content_digest(content: bytes) -> str:
    """Return the SHA-256 of a file's content."""
    return hashlib.sha256(content).hexdigest()


def episode_id(digest: str) -> int:
    """Return the episode id of a recording with this digest.

    The id has 63 bits so that a signed integer column can hold it.
    """
    return int(digest[:16], 16) >> 1


class Searches(NamedTuple):
    """Measures to compute that take a search.

    Attributes:
        steps_to_go: The steps to go of a failed episode.
        useful: Whether inactive seats could act usefully.
    """

    steps_to_go: bool = False
    useful: bool = False


NO_SEARCHES = Searches()


def recorded_rows(content: bytes, number: int, searches: Searches = NO_SEARCHES) -> Iterator[Part]:
    """Yield the rows of a recording in parts. The last part has the summary rows.

    Args:
        number: The episode id.
        searches: The measures to compute that take a search.

    Raises:
        RecordingError: The content is damaged or not a recording. Discard the earlier parts.
    """
    stream, fault = plain(content)
    if fault:
        raise RecordingError(fault)
    try:
        rows = None
        useful = useful_steps(content) if searches.useful else None
        for rows in _builders(stream, number, useful, closed=is_closed(content)):
            if rows.full():
                yield rows.take_rows()
        if rows is None:
            raise RecordingError("no header")
        sought = searches.steps_to_go and rows.success is False
        summary = _summary(rows, steps_left(content) if sought else UNKNOWN)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise RecordingError(f"inconsistent frames: {error!r}") from None
    yield summary


def _builders(
    stream: bytes, number: int, useful: Sequence[Collection[str]] | None, *, closed: bool
) -> Iterator[RowBuilder]:
    """Yield the builder after each frame."""
    rows, ended, end = None, False, 0
    for place, (frame, end) in enumerate(frames_with_ends(stream)):
        check_frame(frame, place)
        if ended:
            raise RecordingError(f"damaged at byte {end}: a frame after the footer")
        if rows is not None:
            rows.add(frame)
        elif frame["kind"] == "header":
            rows = RowBuilder(frame, number, useful)
        else:
            return
        ended = frame["kind"] == "footer"
        yield rows
    if closed and not (ended and end == len(stream)):
        raise RecordingError("damaged: the file is closed but has no footer")


def _summary(rows: RowBuilder, left: StepsLeft) -> Part:
    taken = rows.take_rows()
    summary: list[TableRows] = [
        (SEATS, rows.seats()),
        (LABELS, rows.labels()),
        (MEASURES, [rows.measures(left)]),
        (EPISODES, [rows.episode()]),
    ]
    texts = (cell for _, found in summary for row in found for cell in row if isinstance(cell, str))
    return Part([*taken.tables, *summary], taken.size + sum(map(_memory, texts)))
