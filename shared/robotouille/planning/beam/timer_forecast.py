"""What the running timers of a state will bring about by themselves."""

from __future__ import annotations

from typing import NamedTuple

from robotouille.planning.beam.object_operators import WAITING
from robotouille.world.grounding.effects import HOLDING, Effect
from robotouille.world.timers import Timers
from robotouille.world.world import World

__all__ = ["Forecast", "Forecaster"]

MAX_KEPT = 100_000
MAX_STEPS = 10_000


class Forecast(NamedTuple):
    """The facts once every delay that runs is over: `(facts | touched) ^ removed`.

    `waiting` is the price of what is still to be waited for, `longest` the steps until then;
    `repeated` the effects of repeated actions that have begun, with how often they were performed.
    """

    touched: int
    removed: int
    waiting: float
    longest: int
    repeated: tuple[tuple[Effect, float], ...]


NOTHING = Forecast(0, 0, 0.0, 0, ())


class Forecaster:
    """Lets timers run out while nobody acts, and remembers what came of it."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._known: dict[tuple[Timers, int], Forecast] = {}

    def __call__(self, facts: int, timers: Timers) -> Forecast:
        """The forecast for a state."""
        if not timers.entries:
            return NOTHING
        key = (timers, facts & (timers.reads | self._world.table.internal))
        found = self._known.get(key)
        if found is None:
            if len(self._known) > MAX_KEPT:
                self._known.clear()
            found = self._known[key] = self._run(facts, timers)
        return found

    def _run(self, facts: int, timers: Timers) -> Forecast:
        repeated = _repeated(timers)
        touched = removed = longest = 0
        waiting = 0.0
        timers = self._world.timers.get(timers.entries, ())
        for _ in range(MAX_STEPS):
            if not timers.entries:
                break
            change = timers.tick(facts)
            if change.timers is timers:
                break
            facts = (facts | change.touched) ^ change.removed
            removed = (removed & ~change.touched) | change.removed
            touched |= change.touched
            timers = change.timers
            running = sum(1 for effect, progress in timers.entries if _runs(effect, progress))
            waiting += WAITING * running
            longest += bool(running)
        return Forecast(touched, removed, waiting, longest, repeated)


def _runs(effect: Effect, progress: tuple[int, ...]) -> bool:
    held = effect.root.kind != "conditional" or progress[0] == HOLDING
    return held and any(n.kind == "delayed" and progress[n.slot] >= 0 for n in effect.counters())


def _repeated(timers: Timers) -> tuple[tuple[Effect, float], ...]:
    return tuple(
        (effect, float(progress[node.slot]))
        for effect, progress in timers.entries
        for node in effect.counters()
        if node.kind == "repetitive" and progress[node.slot] > 0
    )
