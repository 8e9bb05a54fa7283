"""Recordings as a page in a single file, which browsers show without a server.

The data contain the messages that a player's page would have received: a snapshot and deltas. This
module adds the times, activities and events from the recordings.
"""

from __future__ import annotations

import base64
import hashlib
import sys
from array import array
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from robotouille.certification.certificate import Deadline
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.pictures import PictureError, plain_picture, read_picture
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.domain.task import Task
from robotouille.episode import TEAM_TOPIC, RejectionKind
from robotouille.episode.tallies import Activity
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.installation import VERSION
from robotouille.protocol.states import StateReader, why_row
from robotouille.replay.annotations import Codebook
from robotouille.replay.controllers import Seating, seatings
from robotouille.replay.distances import StateSource, estimates
from robotouille.replay.measures import activities, rejection_kind
from robotouille.replay.rates import recorded_rate
from robotouille.replay.recording import Recording
from robotouille.replay.timeline import DEPARTURES, pauses
from robotouille.web.single_file import JsonRows, single_file
from robotouille.web.site import STATIC, look_files
from robotouille.world.unmet import UnmetKind, only_words, unmet_from
from robotouille.world.world import State, World

FORMAT = 1
"""Version of the data, for programs that read pages."""
MAX_SHOWN = 2
"""Recordings in one page."""
SNAPSHOT = ("facts", "timers", "busy", "orders")
"""Fields of a recorded state that a snapshot has, besides the tables."""
DELTA = ("objects", "atoms", "add", "remove", "timers", "busy", "orders")
"""Fields of a recorded step that a delta has."""
LETTERS = dict(zip(Activity, "sxabwi", strict=True))
"""Letter of each activity. An unknown one has `?`."""
MAX_DATA = 64 * 1024 * 1024
"""Bytes of memory for the data of a page. A browser needs several times as much."""
MAX_UNREAD = 2_000
"""Rejected texts without an action after which no more are read. Each takes a millisecond, and a
recording can have 300,000."""
EXPANSIONS = 500
"""Search budget of one plan for the steps to go."""

Row = list[Any]


@dataclass(slots=True)
class Names:
    """Names as the page shows them: as recorded, or `p1`, `p2`, … in the order of appearance."""

    anonymous: bool
    charge: Callable[[int], None] = lambda size: None
    _known: dict[str, str] = field(default_factory=dict)

    def shown(self, name: str) -> str:
        """Return the name to show."""
        if not self.anonymous or not name:
            return name
        if name not in self._known:
            self.charge(2 * sys.getsizeof(name))
        return self._known.setdefault(name, f"p{len(self._known) + 1}")

    def text(self, text: str) -> str:
        """Return a participant's text, or an empty one if the page is anonymous."""
        return "" if self.anonymous else text


class PageSizeError(RobotouilleError):
    """The data of a page are too large."""


class _Room:
    """Room for the data of a page."""

    def __init__(self) -> None:
        self._left = MAX_DATA

    def take(self, size: int) -> None:
        """Take some bytes; raise PageSizeError if there is no more room."""
        self._left -= size
        if self._left < 0:
            raise PageSizeError(
                f"a page shows at most {MAX_DATA >> 20} MiB of data, and this recording has more; "
                "watch it with `robotouille replay play`"
            )


def replay_page(
    recordings: Sequence[tuple[str, Recording]],
    *,
    rendering: str = "",
    anonymous: bool = False,
    to_go: Sequence[Sequence[Row | None]] = (),
    codebook: Codebook | None = None,
) -> str:
    """Return the page of one recording, or of two recordings of the same task.

    Args:
        recordings: Recordings and their labels.
        rendering: Name of a rendering. Default: the domain's own.
        anonymous: True to leave out names and texts of participants.
        to_go: The value of `steps_to_go` for each recording; empty if they are unknown.
        codebook: Labels that the reader can give to steps of a single recording.

    Raises:
        RobotouilleError: The recordings cannot be shown together, or have no usable look.
    """
    data = page_data(
        recordings, rendering=rendering, anonymous=anonymous, to_go=to_go, codebook=codebook
    )
    page = (STATIC / "replay/index.html").read_text(encoding="utf-8")
    return single_file("replay/main.js", page, ["page.css", "replay/replay.css"], data)


def labels(stems: Sequence[str]) -> list[str]:
    """Return the names of files as labels, without the parts that all of them have.

    >>> labels(["20260102_soup_1bd3", "20260103_soup_0d37"])
    ['20260102 1bd3', '20260103 0d37']
    """
    parts = [stem.split("_") for stem in stems]
    shared = set.intersection(*map(set, parts)) if len(parts) > 1 else set()
    own = [[part for part in each if part not in shared] for each in parts]
    return [" ".join(each) or stem for each, stem in zip(own, stems, strict=True)]


def page_data(
    recordings: Sequence[tuple[str, Recording]],
    *,
    rendering: str = "",
    anonymous: bool = False,
    to_go: Sequence[Sequence[Row | None]] = (),
    codebook: Codebook | None = None,
) -> dict[str, Any]:
    """Return the data of a page; see `replay_page`."""
    _check(recordings)
    if codebook is not None and len(recordings) > 1:
        raise RobotouilleError("a page with a codebook shows one recording")
    room = _Room()
    names = Names(anonymous, room.take)
    task = recordings[0][1].task
    rows, kinds = [], set(_words(task.json["problem"]))
    for number, (label, recording) in enumerate(recordings):
        reading = _Reading(recording, names, room.take)
        row = {"label": names.text(label), **reading.row()}
        kinds |= reading.kinds
        if to_go and any(to_go[number]):
            row["to_go"] = to_go[number]
        rows.append(row)
    return {
        "format": FORMAT,
        "software": VERSION,
        "anonymous": anonymous,
        "task": task.json,
        "look": _look(task, rendering_of(task, rendering), kinds),
        "recordings": rows,
        **(
            {"codebook": codebook.model_dump(mode="json", include={"labels"})}
            if codebook is not None
            else {}
        ),
    }


def _check(recordings: Sequence[tuple[str, Recording]]) -> None:
    if not 1 <= len(recordings) <= MAX_SHOWN:
        raise RobotouilleError(f"at most two recordings fit side by side, not {len(recordings)}")
    if len({recording.header["digest"] for _, recording in recordings}) > 1:
        shown = ", ".join(f"{label} is of {recording.task.name}" for label, recording in recordings)
        raise RobotouilleError(
            f"only recordings of the same task can be shown side by side: {shown}"
        )


def _words(value: Any) -> Iterator[str]:
    """Yield all texts in JSON values, also those that are keys."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from (key, *_words(each))
    elif isinstance(value, Sequence):
        for each in value:
            yield from _words(each)


def _look(task: Task, rendering: RenderingFile, kinds: set[str]) -> dict[str, Any]:
    """Return the rendering, the key bindings, and the pictures that can appear."""
    pictures = {}
    for file in sorted({file for place, file in rendering.pictures() if _appears(place, kinds)}):
        places = (folder / file for folder in rendering.folders(task.folder))
        found = next((path for path in places if path.is_file()), None)
        if found is None:
            continue  # The page draws a tile with the kind's name.
        try:
            content = read_picture(found)
            content = plain_picture(found.name, content)
        except (OSError, PictureError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise RobotouilleError(f"{found}: {why}") from None
        if file.endswith(".svg"):
            pictures[file] = content.decode("utf-8", "replace")
        else:
            pictures[file] = f"data:image/png;base64,{base64.b64encode(content).decode()}"
    return {**look_files(rendering, bindings_of(task)), "pictures": pictures}


def _appears(place: str, kinds: set[str]) -> bool:
    """Return whether a picture can appear, by its place in the rendering file."""
    group, _, kind = place.partition(".entities.")
    return not kind or group not in ("item", "station", "container") or kind.split(".")[0] in kinds


class _Reading:
    """Conversion of one recording.

    Rejected actions and reasons repeat, so each distinct one is stored once in a table.
    """

    def __init__(self, recording: Recording, names: Names, charge: Callable[[int], None]) -> None:
        self.kinds: set[str] = set()
        self._recording = recording
        self._charge = charge
        self._names = names
        self._players = recording.world.players
        self._places = {player: place for place, player in enumerate(self._players)}
        self._actions: dict[tuple[str, ...], int] = {}
        self._deltas = JsonRows(charge=charge)
        self._moves = JsonRows(charge=charge)
        self._log = JsonRows(charge=charge)
        self._log_steps = array("q")
        self._seated: dict[str, tuple[str, str]] = {}
        self._reader: StateReader | None = None
        self._snapshot: dict[str, Any] = {}
        self._unread = 0
        self._time = 0
        self._times = [0]
        self._lanes: dict[str, list[str]] = {player: [] for player in self._players}
        self._fault = recording.damage

    def row(self) -> dict[str, Any]:
        """Return the recording as JSON values, up to its damage."""
        recording = self._recording
        self._read()
        length = len(self._deltas)
        rules, outcome = recording.header["rules"], recording.outcome
        return {
            "digest": hashlib.sha256(recording.stream).hexdigest(),
            "steps": length,
            "max_steps": rules["max_steps"],
            "rate": recorded_rate(rules),
            "clock": rules["clock"],
            # Differences are short numbers that repeat.
            "times": [later - earlier for earlier, later in pairwise(self._times)],
            "snapshot": self._snapshot,
            "deltas": self._deltas,
            "lanes": ["".join(lane) for lane in self._lanes.values()],
            "actions": [list(action) for action in self._actions],
            "moves": self._moves,
            "seats": JsonRows(self._seatings(length), self._charge),
            "log": self._log,
            "pauses": JsonRows(self._pauses(length), self._charge),
            "outcome": self._outcome(outcome) if outcome and not self._fault else None,
            "fault": self._fault,
        }

    def _pauses(self, length: int) -> Iterator[Row]:
        for pause in pauses(self._recording):
            if pause.step <= length:
                yield [pause.step, pause.t, list(pause.holds), pause.seconds]

    def _outcome(self, outcome: Mapping[str, Any]) -> dict[str, Any]:
        kept = {key: outcome[key] for key in ("reason", "steps", "seconds")}
        score = {"score": outcome["score"]} if outcome.get("score") else {}
        detail = self._names.text(outcome["detail"])
        return {**kept, **score, **({"detail": detail} if detail else {})}

    def _seatings(self, length: int) -> Iterator[Row]:
        """Yield the step from which the seats are as in a row, and their names and kinds."""
        before: Mapping[str, Seating] | None = None
        for step, seats in seatings(self._recording):
            if step > length:
                return
            if seats is not before:
                before = seats
                rows = [seats[player] for player in self._players]
                yield [step, [[self._names.shown(r.name), r.kind, r.controller] for r in rows]]

    def _read(self) -> None:
        try:
            for _, step in activities(self):
                for player, lane in self._lanes.items():
                    lane.append(LETTERS[step.did[player]] if player in step.did else "?")
                self._charge(8 * len(self._lanes) + sys.getsizeof(self._time))
                self._times.append(self._time)
        except PageSizeError:
            raise
        except RobotouilleError as error:
            self._fault = self._fault or str(error)
        # Frames are valid MessagePack but may hold anything. The part read so far can still be
        # shown.
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            self._fault = self._fault or f"its content is inconsistent: {error!r}"
        if self._reader is None:
            raise RobotouilleError(self._fault or "the recording has no state")
        # The last step may be the one with the fault.
        length = len(self._times) - 1
        self._deltas.cut(length)
        self._moves.cut(length)
        self._log.cut(bisect_right(self._log_steps, length))

    def each_frame(self, *, states: bool = True) -> Iterator[dict[str, Any]]:
        """Yield the frames, each after it was converted."""
        for frame in self._recording.each_frame():
            step = len(self._deltas)
            self._time = frame.get("t", 0)
            if frame["kind"] == "state" and self._reader is None:
                self._begin(frame)
            elif frame["kind"] == "step":
                if frame["step"] != step + 1:
                    raise RecordingError(f"step {step + 1} is missing")
                self._take(frame)
            elif frame["kind"] == "notes":
                for note in frame["notes"]:
                    self._note(step, note)
            yield frame

    @property
    def world(self) -> World:
        """The world of the recording."""
        return self._recording.world

    def _begin(self, frame: dict[str, Any]) -> None:
        tables = self._recording.header["tables"]
        self._reader = StateReader(self._recording.world, tables, frame)
        self._snapshot = {"step": 0, **tables, **{k: frame[k] for k in SNAPSHOT if k in frame}}
        self.kinds.update(kind for _, kind, _ in tables["objects"])

    def _take(self, frame: dict[str, Any]) -> None:
        reader = self._reader
        if reader is None:
            raise RobotouilleError("the recording has a step before its first state")
        step, unmet = frame["step"], frame.get("unmet", {})
        reader.apply(frame)
        self.kinds.update(kind for _, kind, _ in frame.get("objects", ()))
        self._deltas.append({key: frame[key] for key in DELTA if frame.get(key)})
        row: Row = []
        for place, move in enumerate(frame["moves"]):
            seat, action = self._place(move["player"]), self._action(move["action"])
            if str(place) in unmet:
                why = self._reasons(unmet[str(place)], ())
                self._add(step, frame["t"], "lost", seat, action, why)
            else:
                row += [seat, action]
            if thought := self._names.text(move.get("reasoning", "")):
                self._add(step, frame["t"], "thought", seat, thought)
        self._moves.append(row)

    def _add(self, step: int, *row: Any) -> None:
        """Add a row to the log."""
        self._log.append([step, *row])
        self._log_steps.append(step)

    def _action(self, action: Iterable[str]) -> int:
        words = tuple(action)
        if words not in self._actions:
            self._charge(2 * sys.getsizeof(words) + sum(map(sys.getsizeof, words)))
        return self._actions.setdefault(words, len(self._actions))

    def _place(self, player: str) -> int:
        """Return the number of a seat, or -1 for a spectator."""
        return self._places.get(player, -1)

    def _reasons(
        self, words: Sequence[str], rows: Sequence[Mapping[str, Any]]
    ) -> list[dict[str, Any]]:
        """Return reasons as the page's wording reads them; other reasons keep their words."""
        found = unmet_from(words, rows) if rows else only_words(*words)
        return [
            {**why_row(each), **({} if each.predicate or each.objects else {"words": each.words})}
            for each in found
        ]

    def _note(self, step: int, note: Mapping[str, Any]) -> None:
        made = _NOTES.get(note["note"])
        rows = made(self, note) if made else None
        if rows is not None:
            self._add(step, note["t"], *rows)

    def _said(self, note: Mapping[str, Any]) -> Row:
        name, text = self._names.shown(note["name"]), self._names.text(note["text"])
        row = ["said", self._place(note["player"]), name, text]
        if note.get("intent"):
            row += [note["intent"], note.get("target", "")]
        return row

    def _noted(self, note: Mapping[str, Any]) -> Row | None:
        # Bots announce their version to each other; people need not see that.
        text = self._names.text(note["text"])
        if note["topic"] == TEAM_TOPIC or not text:
            return None
        return ["noted", self._place(note["player"]), f"{note['topic']}: {text}"]

    def _announced(self, note: Mapping[str, Any]) -> Row:
        return ["announced", -1, self._names.text(note["text"])]

    def _restarted(self, note: Mapping[str, Any]) -> Row:
        return ["restarted", -1]

    def _roster(self, note: Mapping[str, Any]) -> Row | None:
        """Return who came, left, was away or returned."""
        player, name = note["player"], note["name"]
        if player not in self._places:
            return None
        before = self._seated.get(player)
        place, substitute = self._place(player), note.get("controller") == "substitute"
        if not note["taken"] or not name:
            self._seated.pop(player, None)
            if before is None:
                return None
            how = note.get("why", "") if note.get("why") in DEPARTURES else "left"
            return [how, place, self._names.shown(before[0]), substitute]
        self._seated[player] = (name, note["session"])
        what = "back"
        if not note["present"]:
            what = "away"
        elif before is None or (before[0] != name and before[1] != note["session"]):
            what = "joined"
        return [what, place, self._names.shown(name), substitute]

    def _rejected(self, note: Mapping[str, Any]) -> Row | None:
        kind = rejection_kind(note)
        if kind is RejectionKind.SUPERSEDED:
            return None
        place, reader = self._place(note["player"]), self._reader
        state = reader.state if reader is not None else self._recording.world.initial
        action: int | str = self._parsed(note, state)
        reasons = self._reasons(note["reasons"], note.get("why", ()))
        if isinstance(action, str) or kind is RejectionKind.MALFORMED:
            # The text is a participant's, and the words of the reasons may quote it.
            action = self._names.text(str(note.get("text") or note["action"]))
            reasons = [] if self._names.anonymous else reasons
        if self._names.anonymous:
            reasons = [reason for reason in reasons if reason["kind"] != UnmetKind.OTHER]
        return ["rejected", place, action, reasons]

    def _parsed(self, note: Mapping[str, Any], state: State) -> int | str:
        """Return the number of a rejected action, or its text if it names none."""
        if self._unread >= MAX_UNREAD:
            return str(note["action"])
        try:
            found = self._recording.world.parse(state, note["player"], note["action"], valid=False)
        except RobotouilleError:
            self._unread += 1
            return str(note["action"])
        return self._action((found.name, *found.arguments))


_NOTES: Mapping[str, Callable[[_Reading, Mapping[str, Any]], Row | None]] = {
    "said": _Reading._said,
    "noted": _Reading._noted,
    "announced": _Reading._announced,
    "restarted": _Reading._restarted,
    "roster": _Reading._roster,
    "rejected": _Reading._rejected,
}


def steps_to_go(
    recording: StateSource, length: int, deadline: Deadline, expansions: int = EXPANSIONS
) -> Iterator[list[Row | None]]:
    """Yield what is known about the steps to go, step by step, as it becomes more.

    A row is `[least, most]`, with `most` null if no plan is known, or `[-1, null]` if the goal is
    out of reach. The same list is yielded each time.

    Args:
        length: Number of steps.
        deadline: Returns True when the time is up.
        expansions: Search budget for one plan.
    """
    known: dict[int, tuple[int, int | None, bool]] = defaultdict(lambda: (0, None, False))
    rows: list[Row | None] = [None] * (length + 1)
    for step, left in estimates(recording, expansions, deadline):
        least, most, dead = known[step]
        lengths = [each for each in (most, left.steps) if each is not None]
        known[step] = (max(least, left.bound), min(lengths, default=None), dead or left.dead)
        least, most, dead = known[step]
        if step <= length:
            rows[step] = [-1, None] if dead else [least, most]
        yield rows
