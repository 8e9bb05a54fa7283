"""In-context examples from recordings of people and bots.

    choices = recorded_choices(read_recording("ada.rbt"))
    pack = with_examples(build_own_pack(), "mine", [episodes_by_form("ada", choices)])

An example shows the applied actions of one seat. Pauses and mistakes are left out, and a single
player waits only where the kitchen requires it: people need time to think, and models do not.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from robotouille import GroundAction, State, World
from robotouille.domain.task import Timing
from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.replay import Recording
from robotouille.replay.conduct import rules_in
from robotouille_evaluation.packs.example_episodes import REACT, ExampleChoice, example_sets
from robotouille_evaluation.packs.pack import ExampleEpisode, Pack

UPCOMING = 3
"""Number of next actions in a reasoning that the recording lacks."""
MAX_ACTIONS = 1_000
"""Most actions of an example. A game of people has up to 300."""
MAX_STEPS = 200_000
"""Most steps that are simulated to leave out pauses: some seconds."""


def recorded_choices(recording: Recording, seat: str = "") -> list[ExampleChoice]:
    """Return the choices of a seat, by default the only one, up to the goal.

    The reasoning is the recorded one. Without it, the reasoning names the next actions.

    Raises:
        UnknownNameError: The seat is unknown, or there are several and none is named.
        RobotouilleError: The episode does not reach a goal, the seat does nothing in it, or its
            players saw a part of the kitchen only.
    """
    world = recording.world
    player = _seat(recording, seat)
    if world.shift is not None:
        raise RobotouilleError(f"{recording.source}: is a shift, and examples need a goal")
    if rules_in(recording.header).limited_sight is not None:
        # The text of an example is that of the whole kitchen.
        raise RobotouilleError(f"{recording.source}: its players saw a part of the kitchen only")
    played = _played(recording, player)
    if not played:
        raise RobotouilleError(f"{recording.source}: {player} does nothing")
    if len(world.players) == 1:
        played = _without_pauses(played, recording)
    return [*_with_reasoning(played)]


def _seat(recording: Recording, seat: str) -> str:
    players = recording.world.players
    if not seat and len(players) == 1:
        return players[0]
    if seat not in players:
        what = f"unknown seat {seat!r}{did_you_mean(seat, players)}" if seat else "several seats"
        message = f"{recording.source}: {what}; choose --seat {' or '.join(players)}"
        raise UnknownNameError(message)
    return seat


def _played(recording: Recording, player: str) -> list[ExampleChoice]:
    """Return the applied actions of a player up to the goal, except waiting.

    Raises:
        RobotouilleError: The goal is not reached, or only after more than `MAX_ACTIONS` actions.
    """
    found: list[ExampleChoice] = []
    reached = False
    for request in recording.transitions():
        if reached and request.state.goal_reached:
            break
        reached = reached or request.next_state.goal_reached
        if request.seat != player or request.state.goal_reached or not request.valid:
            continue
        if request.action is None or _is_wait(request.action):
            continue
        if len(found) <= MAX_ACTIONS:
            found.append(ExampleChoice(request.state, request.action, request.reasoning))
    if not reached:
        raise RobotouilleError(
            f"{recording.source}: does not reach the goal, so it is no good example"
        )
    if len(found) > MAX_ACTIONS:
        raise RobotouilleError(
            f"{recording.source}: more than {MAX_ACTIONS:,} actions, too many for an example"
        )
    return found


def _is_wait(action: GroundAction) -> bool:
    definition = action.schema.definition
    return not (definition.immediate_fx or definition.sfx)


def _without_pauses(played: Sequence[ExampleChoice], recording: Recording) -> list[ExampleChoice]:
    """Return the choices in the benchmark's timing, with as few waits as possible.

    Raises:
        RobotouilleError: The actions do not reach the goal in that timing.
    """
    replays = _Replays(played, World(replace(recording.task, timing=Timing.BENCHMARK)))
    try:
        best = replays.choices(frozenset())
    except _TooLongError:
        best = None
    if best is None:
        raise RobotouilleError(
            f"{recording.source}: its actions do not reach the goal without its pauses"
        )
    # People also pause where they need not. Each pause is left out if the rest still works.
    at_once: frozenset[int] = frozenset()
    with suppress(_TooLongError):
        for place in range(len(played)):
            shorter = replays.choices(at_once | {place})
            if shorter is not None and len(shorter) <= len(best):
                best, at_once = shorter, at_once | {place}
    return best


class _TooLongError(Exception):
    """Replays that take more than `MAX_STEPS`."""


class _Replays:
    """Replays of choices in another timing, with waits between them."""

    def __init__(self, played: Sequence[ExampleChoice], world: World) -> None:
        self._played = played
        self._world = world
        self._left = MAX_STEPS

    def choices(self, at_once: Collection[int]) -> list[ExampleChoice] | None:
        """Return the choices with waits between them, or None if they do not reach the goal.

        Args:
            at_once: Places of choices that wait only until they apply, and not until the kitchen
                is as it was recorded.

        Raises:
            _TooLongError: The replays take too many steps in all.
        """
        state, choices = self._world.initial, []
        for place, choice in enumerate(self._played):
            action = self._world.action(choice.action.name, *choice.action.arguments)
            waits = self._waits(state, action, None if place in at_once else choice.state)
            if waits is None:
                return None
            for each in (*waits, ExampleChoice(state, action, choice.reasoning)):
                choices.append(replace(each, state=state))
                state = self._step(state, each.action)
        return choices if state.goal_reached else None

    def _waits(
        self, state: State, action: GroundAction, recorded: State | None
    ) -> list[ExampleChoice] | None:
        """Return the waits after which the action applies, if possible in the recorded kitchen.

        None if the action never applies.
        """
        player = self._world.players[0]
        wait = next((each for each in state.actions(player) if _is_wait(each)), None)
        waits: list[ExampleChoice] = []
        usable = None
        while True:
            if self._world.applicable(state, action):
                if recorded is None or state.facts == recorded.facts:
                    return waits
                usable = len(waits) if usable is None else usable
            after = state if wait is None else self._step(state, wait)
            if after == state or wait is None:
                return None if usable is None else waits[:usable]
            waits.append(ExampleChoice(state, wait, ""))
            state = after

    def _step(self, state: State, action: GroundAction) -> State:
        # A recording can ask for any number of waits: delays are long, and some states never rest.
        self._left -= 1
        if self._left < 0:
            raise _TooLongError
        return state.step(action).state


def _with_reasoning(choices: Sequence[ExampleChoice]) -> Iterator[ExampleChoice]:
    for place, choice in enumerate(choices):
        upcoming = [each.action.sentence for each in choices[place : place + UPCOMING]]
        words = f"My next steps are: {'; '.join(upcoming)}."
        yield replace(choice, reasoning=choice.reasoning or words)


def with_examples(
    pack: Pack,
    name: str,
    episodes: Sequence[Mapping[str, ExampleEpisode]],
    datasets: Sequence[str] = (),
) -> Pack:
    """Return a pack under a new name with these examples in place of its own.

    Args:
        datasets: Datasets in which they are shown; all if empty.

    Raises:
        UnknownNameError: The pack lacks a data set.
        RobotouilleError: The built-in strategies, which show examples, cannot play the pack.
    """
    if REACT not in {prompt.id for prompt in pack.prompts}:
        raise RobotouilleError(
            f"{pack.name} has the published prompts only, whose examples are fixed; choose ours"
        )
    for dataset in datasets:
        if dataset not in pack.datasets:
            near = did_you_mean(dataset, pack.datasets) or f"; choose {', '.join(pack.datasets)}"
            raise UnknownNameError(f"unknown data set {dataset!r}{near}")
    shown = [
        found for dataset in datasets or pack.datasets for found in example_sets(dataset, episodes)
    ]
    replaced = {found.name for found in shown}
    kept = [found for found in pack.examples if found.name not in replaced]
    return replace(pack, name=name, examples=(*kept, *shown))
