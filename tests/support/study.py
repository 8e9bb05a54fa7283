"""A made-up study: labelled recordings of pairs that play several rounds, in two conditions.

Its people follow the plan that lies beside the task, with human reaction times: now and then they
ask for what cannot be done, look on, talk, lose their connection; and each round is quicker. One
seed, one study, byte for byte.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from robotouille import GroundAction, World, load_task
from robotouille.certification.shipped_plan import plan_beside
from robotouille.domain.task import Timing
from robotouille.episode import Absence, Clock, Episode, Rules, Stepped
from robotouille.errors import ProtocolError
from robotouille.planning.plan import Plan
from robotouille.planning.policies import Script
from robotouille.replay.container import compress
from robotouille.replay.recorder import Recorder, header

__all__ = ["Condition", "write_study"]

TASK = "multi_agent/02@2"
STEP_RATE = 4.0
TICK = 0.05
TALK = (
    "I take the lettuce", "you cook, I cut", "wait, let me through", "the patty is done",
    "who serves?", "mine!", "ok", "sorry", "on my way to the board",
)  # fmt: skip
WATCHING = 0.4
"""Seconds for which somebody thinks again who sees nothing to do."""


@dataclass(frozen=True, slots=True)
class Condition:
    """What pairs of a condition are like: seconds for a decision at first, and how often in a
    decision they err, talk, and lose their connection."""

    name: str
    decision: float
    erring: float
    talking: float
    losing: float
    absence: Absence


CONDITIONS = (
    Condition("together", 0.55, 0.10, 0.05, 0.004, Absence.BOT),
    Condition("apart", 0.9, 0.28, 0.0, 0.012, Absence.WAIT),
)


@dataclass(slots=True)
class _Person:
    """Somebody at a seat: when the next decision falls, and until when they are away."""

    player: str
    script: Script
    rng: random.Random
    condition: Condition
    pace: float
    decides: float | None = None
    back: float | None = None
    seq: int = field(default=0)

    def turn(self, episode: Episode, now: float) -> None:
        """What they do at a moment."""
        if self.back is not None:
            if now >= self.back:
                self.back = None
                episode.set_present(self.player, True, now)
            return
        if episode.state.busy_steps(self.player):
            self.decides = None
            return
        if self.decides is None:
            self.decides = now + self.pace * self.rng.lognormvariate(0.0, 0.55)
        if now >= self.decides:
            self.decides = None
            self._decide(episode, now)

    def _decide(self, episode: Episode, now: float) -> None:
        chance, its = self.rng.random(), self.condition
        if chance < its.losing:
            self.back = now + self.rng.uniform(2.0, 9.0)
            episode.set_present(self.player, False, now)
            return
        if self.rng.random() < its.talking:
            episode.say(self.player, self.player, self.rng.choice(TALK), now)
        action = self.script.act(episode.state)
        if self.rng.random() < its.erring:
            action = _impossible(episode, self.player, self.rng)
        if action is None:
            self.decides = now + WATCHING
            return
        self.seq += 1
        with suppress(ProtocolError):
            episode.submit(self.player, self.seq, action, now, basis=episode.step)


def write_study(folder: Path, *, pairs: int = 4, rounds: int = 3, seed: int = 0) -> list[Path]:
    """Write the recordings of so many pairs for each condition, each of so many rounds."""
    folder.mkdir(parents=True, exist_ok=True)
    world, known = World(load_task(TASK, timing=Timing.PEOPLE)), World(load_task(TASK))
    plan = plan_beside(known)
    assert plan is not None
    paths = []
    for condition in CONDITIONS:
        for pair in range(1, pairs + 1):
            name = f"{condition.name}-{pair}"
            for number in range(1, rounds + 1):
                stream = _play(world, known, plan, condition, name, number, seed)
                paths.append(folder / f"{name}-{number}.rbt")
                paths[-1].write_bytes(compress(stream))
    return paths


def _play(
    world: World,
    known: World,
    plan: Plan,
    condition: Condition,
    pair: str,
    number: int,
    seed: int,
) -> bytes:
    rng = random.Random(f"{seed}:{pair}:{number}")
    rules = Rules(
        clock=Clock.REALTIME,
        step_rate=STEP_RATE,
        max_steps=150,
        absence=condition.absence,
        grace=60,
    )
    episode, recorder = Episode(world, rules), Recorder(world)
    labels = {"condition": condition.name, "pair": pair, "round": str(number), "study": "made up"}
    created = f"2026-03-{number:02}T10:00:00Z"
    head = header(world.task, rules, episode=f"{pair}-{number}", created=created, labels=labels)
    stream = recorder.begin(head)
    people = list(_people(known, plan, condition, pair, number, rng))
    for place, person in enumerate(people):
        name = f"{pair}{'ab'[place]}"
        episode.join(person.player, name, "human", 0.0, participant=name)
    now = 0.0
    while not episode.ended:
        now = round(now + TICK, 3)
        for person in people:
            if not episode.ended:
                person.turn(episode, now)
            _stand_in(episode, people, now)
        episode.tick(now)
        events = list(episode.events())
        _tell(people, events)
        stream += recorder.record(events)
    return stream


def _people(
    known: World, plan: Plan, condition: Condition, pair: str, number: int, rng: random.Random
) -> Iterator[_Person]:
    """The two of a pair, of whom one is quicker than the other; both learn from round to round."""
    for player in known.players:
        own = random.Random(f"{pair}:{player}").uniform(0.75, 1.35)
        pace = condition.decision * own / number**0.4
        script = Script(player, plan, known.initial)
        yield _Person(player, script, random.Random(rng.random()), condition, pace)


def _impossible(episode: Episode, player: str, rng: random.Random) -> GroundAction | None:
    """Something that cannot be done now, so that it changes nothing."""
    state = episode.state
    wanted = rng.choice(state.world.ground_actions(player))
    return None if state.world.applicable(state, wanted) else wanted


def _stand_in(episode: Episode, people: Iterable[_Person], now: float) -> None:
    """A bot plays for who is away, where the rules say so."""
    for person in people:
        away = person.back is not None and not episode.ended
        free = not episode.state.busy_steps(person.player)
        if away and free and episode.rules.absence is Absence.BOT:
            episode.substitute(person.player, person.script.act(episode.state), now)


def _tell(people: Iterable[_Person], events: Iterable[object]) -> None:
    for event in events:
        if isinstance(event, Stepped):
            pairs = zip(event.moves, event.attempts, strict=True)
            did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
            for person in people:
                person.script.observe(did)
