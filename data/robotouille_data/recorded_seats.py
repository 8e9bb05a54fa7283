"""Seats of a recording, and facts about recorded tasks, derived from frames without a world."""

from __future__ import annotations

import json
import random
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any

import msgpack

from robotouille.certification.certificate import content_hash
from robotouille.episode import Controller, RejectionKind
from robotouille.episode.rules import Clock
from robotouille.episode.tallies import Activity, activity
from robotouille.errors import RobotouilleError
from robotouille.installation import data_folder
from robotouille.planning.beam.opportunities import Opportunities
from robotouille.planning.plan import Limits
from robotouille.planning.steps_to_go import StepsToGo
from robotouille.replay.compression import plain
from robotouille.replay.measures import activities, controller_of, rejection_kind
from robotouille.replay.recording import Recording


class Repeats:
    """Counter of steps that repeat an earlier state and joint action.

    It equals the benchmark's `repeated_transitions`. States are compared by a Zobrist hash of 62
    bits, which changes with each fact in constant time.
    """

    def __init__(self, atoms: int) -> None:
        self.count = 0
        # A fixed seed, so that an index of the same recordings has the same rows on every machine.
        self._random = random.Random(0)
        self._keys: list[int] = []
        self._extend(atoms)
        self._facts = 0
        self._timers: dict[str, tuple[int, ...]] = {}
        self._timer_hash = self._busy_hash = 0
        self._seen: set[int] = set()

    def begin(self, frame: Mapping[str, Any]) -> None:
        """Set the state before the first step.

        Raises:
            IndexError: The state has a fact without a table entry.
        """
        for fact in frame["facts"]:
            self._facts ^= self._keys[fact]
        for label, counters in frame["timers"]:
            self._set_timer(str(label), tuple(counters))
        self._busy_hash = hash(frozenset(frame["busy"].items()))

    def step(self, frame: Mapping[str, Any], actions: tuple[Any, ...]) -> None:
        """Add a step with its applied actions.

        Raises:
            IndexError: The step adds or removes a fact without a table entry.
        """
        # Only the hash is kept: an episode may have 100,000 steps, and collisions are negligible.
        key = hash((self._facts, self._timer_hash, self._busy_hash, actions))
        if key in self._seen:
            self.count += 1
        self._seen.add(key)
        if "atoms" in frame:
            self._extend(len(frame["atoms"]))
        for fact in frame.get("add", ()):
            self._facts ^= self._keys[fact]
        for fact in frame.get("remove", ()):
            self._facts ^= self._keys[fact]
        for label, counters in frame.get("timers", {}).items():
            self._set_timer(label, None if counters is None else tuple(counters))
        if "busy" in frame:
            self._busy_hash = hash(frozenset(frame["busy"].items()))

    def _extend(self, atoms: int) -> None:
        self._keys += (self._random.getrandbits(62) for _ in range(atoms))

    def _set_timer(self, label: str, counters: tuple[int, ...] | None) -> None:
        # The hash changes with each timer: a hostile recording can have 100,000 of them.
        if (before := self._timers.pop(label, None)) is not None:
            self._timer_hash ^= hash((label, before))
        if counters is not None:
            self._timers[label] = counters
            self._timer_hash ^= hash((label, counters))


ACTIVITIES = ("acted", "busy", "waiting", "idle", "away", "substituted")
INACTIVE = (Activity.WAITING.value, Activity.IDLE.value)
"""Activities of a participant who has control, is not busy and does not act."""
NAMES = {each: each.value for each in Activity}


@dataclass(slots=True)
class RecordedSeat:
    """Current participant and controller of a seat, and its counts so far.

    Attributes:
        refused: True if an action request was rejected since the last step.
        blocked: Rejections since the last step with no other reason than a player at a station.
        based: Actions with a recorded basis.
        stale: Sum of the staleness of these actions.
        work: Applied actions that change an object.
    """

    number: int
    player: str
    name: str = ""
    kind: str = ""
    agent: str = ""
    participant: str = ""
    controller: Controller = Controller.FREE
    refused: bool = False
    blocked: int = 0
    did: dict[str, int] = field(default_factory=lambda: dict.fromkeys(ACTIVITIES, 0))
    waits: int = 0
    unused: int = 0
    hindered: int = 0
    lost: int = 0
    invalid: int = 0
    malformed: int = 0
    rejected: int = 0
    said: int = 0
    thinking: int = 0
    based: int = 0
    stale: int = 0
    work: int = 0

    def activity(self, applied: bool | None, busy: bool, others_turn: bool) -> str:
        """Count and return the activity in a step.

        Args:
            applied: The seat's action was applied (True) or rejected (False). None: no action.
            busy: The player could not act in the state before the step.
            others_turn: With the turn clock, it was another seat's turn.
        """
        found = NAMES[activity(self.controller, applied, busy, self.refused, others_turn)]
        self.did[found] += 1
        return found

    def judge(self, did: str, useful: Collection[str]) -> bool | None:
        """Count and return whether the seat could act usefully; None unless it was inactive.

        Args:
            did: The activity in the step.
            useful: The players who could act usefully in the step.
        """
        if did not in INACTIVE:
            return None
        could = self.player in useful
        self.unused += could
        self.hindered += not could
        return could

    def sit(self, note: Mapping[str, Any]) -> None:
        """Update the participant and controller from a roster note."""
        if note["name"]:
            self.name, self.kind = note["name"], note["kind"]
            self.participant, self.agent = note.get("participant", ""), note.get("agent", "")
        # A new participant is not responsible for requests of the previous one.
        if not note.get("taken", True):
            self.refused = False
        self.controller = controller_of(note)

    def refuse(self, note: Mapping[str, Any], occupied: frozenset[str]) -> None:
        """Count a rejected action request.

        Args:
            occupied: Predicates that hold if no player stands at a station.
        """
        kind = rejection_kind(note)
        self.rejected += 1
        # A superseded request was replaced by the participant itself, so the seat did not wait.
        if kind is RejectionKind.SUPERSEDED:
            return
        self.refused = True
        self.invalid += kind is RejectionKind.INVALID
        self.malformed += kind is RejectionKind.MALFORMED
        why = note.get("why", ())
        self.blocked += bool(why) and all(
            each["kind"] == "condition" and each.get("predicate") in occupied for each in why
        )


def workless_actions(domain: Mapping[str, Any]) -> frozenset[str]:
    """Return the names of the actions that change no object: waiting and walking."""
    return frozenset(
        action["name"]
        for action in domain.get("action_defs", ())
        if action.get("travel")
        or not (action.get("precons") or action.get("immediate_fx") or action.get("sfx"))
    )


def occupied_predicates(domain: Mapping[str, Any]) -> frozenset[str]:
    """Return the predicates, such as `vacant`, that hold if no player stands at a station."""
    rules = domain.get("layout") or ()
    facing = {rule["predicate"] for rule in rules if rule.get("when") == "faces"}
    return frozenset(
        rule["predicate"] for rule in rules if facing.intersection(rule.get("unless") or ())
    )


def player_names(header: Mapping[str, Any]) -> list[str]:
    """Return the players of a recording in the order of their seats."""
    types = set(header["task"]["domain"].get("player_types") or ("player",))
    return [name for name, _, type_ in header["tables"]["objects"] if type_ in types]


def fewest_steps(task: Mapping[str, Any]) -> int | None:
    """Return the shortest plan's length for a recorded task, or None without a certificate."""
    return _fewest_steps(msgpack.packb(task))


@lru_cache(maxsize=64)
def _fewest_steps(packed: bytes) -> int | None:
    # Computing the hash takes longer than reading a hundred steps, so results are cached.
    # Certificates contain the file name of the task. Recordings may also contain its folder.
    task = msgpack.unpackb(packed)
    name = str(task["name"]).rpartition("/")[2]
    text = json.dumps({**task, "name": name}, sort_keys=True, separators=(",", ":"))
    return _certified().get(content_hash(text.encode()))


@cache
def _certified() -> dict[str, int]:
    """Return the lengths of proven shortest plans by the content hash of the task."""
    problems = data_folder("problems")
    rows = json.loads((problems / "generated/manifest.json").read_bytes())["instances"]
    for path in problems.rglob("*.certificate.json"):
        if "generated" not in path.relative_to(problems).parts:
            rows.append(json.loads(path.read_bytes()))
    return {row["instance"]: row["length"] for row in rows if row["optimal"]}


ALONE, FIRST, KNOWN = Limits(expansions=2000), Limits(expansions=50), Limits(expansions=0)
"""Search limits: for one player, for a team's first plan, and for following a known plan."""

StepsLeft = tuple[int | None, int | None, bool | None]
"""Lower bound, upper bound (None: no plan is known), and whether the goal is out of reach. All are
None if they were not computed."""
REACHED: StepsLeft = (0, 0, False)
UNKNOWN: StepsLeft = (None, None, None)


def steps_left(content: bytes) -> StepsLeft:
    """Return the steps to go at the end of a recording, by simulation and search.

    The search is limited by expansions, not by time, so every machine gets the same result. If
    the recording cannot be simulated, the result is `UNKNOWN`.
    """
    try:
        recording = Recording(plain(content)[0])
        world = recording.world
        ((_, state),) = deque(recording.states(), maxlen=1)
        distance = StepsToGo(world)
        # A team's search rarely ends within the limits. A first plan can be followed from later
        # states, which gives an upper bound.
        if len(world.players) > 1:
            distance(world.initial, FIRST)
        left = distance(state, ALONE if len(world.players) == 1 else KNOWN)
    except (RobotouilleError, LookupError, ValueError):
        return UNKNOWN
    return (None, None, True) if left.dead else (left.bound, left.steps, False)


def useful_steps(content: bytes) -> list[frozenset[str]] | None:
    """Return for each step the inactive players who could act usefully in it.

    With the turn clock, only the player on turn can act. The result is None if the recording
    cannot be simulated. It depends on the recording alone, so no cache outlives the call.
    """
    try:
        recording = Recording(plain(content)[0])
        opportunities, players = Opportunities(recording.world), recording.world.players
        by_turns = recording.header["rules"]["clock"] == Clock.TURN
        found = []
        for (step, seats), (_, state) in zip(
            activities(recording), recording.states(), strict=False
        ):
            on_turn = players[(step - 1) % len(players)] if by_turns else None
            found.append(
                frozenset(
                    player
                    for player, did in seats.did.items()
                    if did in INACTIVE
                    and on_turn in (None, player)
                    and opportunities.useful(state, player)
                )
            )
    except (RobotouilleError, LookupError, ValueError):
        return None
    return found
