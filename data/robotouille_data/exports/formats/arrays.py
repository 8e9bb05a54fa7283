"""Trajectories for imitation learning: one `.npz` for each task, with a row a step and seat."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, groupby

import numpy as np

from robotouille.errors import SlotOverflowError, UnknownNameError
from robotouille.world.world import World
from robotouille_data.exports.formats.layouts import action_number, layout_notes
from robotouille_data.exports.formats.npz import GrowingArrays
from robotouille_data.exports.formats.recorded import Replay, replays
from robotouille_data.exports.part import Entry, Field, Part, Written

__all__ = ["write_arrays"]


def write_arrays(part: Part) -> Iterator[Written]:
    """Write a file for each task."""
    for _, its in groupby(replays(part), key=lambda replay: replay.task.digest):
        yield _write_task(part, its)


def _write_task(part: Part, episodes: Iterator[Replay]) -> Written:
    first = next(episodes)
    world = first.world
    name = part.tasks[world.task.digest]
    path = part.folder / f"{name}.npz"
    size = world.encoding.size
    most = max(len(world.ground_actions(player)) for player in world.players)
    part.codebook[name] = _entry(name, world, size, most)
    actions, rewards = 0, 0.0
    with GrowingArrays(part.folder, _fields(size, most)) as arrays:
        for replay in chain([first], episodes):
            rows = arrays.rows
            try:
                sums = _add(arrays, replay, most)
            except (SlotOverflowError, UnknownNameError) as error:
                arrays.cut(rows)
                part.faults[replay.episode_id] = str(error)
                continue
            actions, rewards = actions + sums[0], rewards + sums[1]
        arrays.save(path)
        return Written(name, part.path(path), arrays.rows, {"actions": actions, "rewards": rewards})


def _add(arrays: GrowingArrays, replay: Replay, most: int) -> tuple[int, float]:
    """Add the rows of an episode: the sums of its actions and rewards."""
    actions, rewards = 0, 0.0
    for moment in replay.moments:
        vector = moment.before.vector()
        for seat, player in enumerate(replay.world.players):
            mask = moment.before.mask(player)
            number, move = action_number(moment, player), moment.moves.get(player)
            arrays.append(
                observations=vector,
                masks=np.pad(mask, (0, most - len(mask))),
                actions=number,
                own=move is not None and move.own,
                rewards=moment.reward,
                terminations=moment.after.goal_reached,
                episode=replay.episode_id,
                step=moment.step,
                seat=seat,
            )
            actions, rewards = actions + number, rewards + moment.reward
    return actions, rewards


def _fields(size: int, most: int) -> dict[str, tuple[type, tuple[int, ...]]]:
    return {
        "observations": (np.float32, (size,)),
        "masks": (np.bool_, (most,)),
        "actions": (np.int32, ()),
        "own": (np.bool_, ()),
        "rewards": (np.float32, ()),
        "terminations": (np.bool_, ()),
        "episode": (np.int64, ()),
        "step": (np.int32, ()),
        "seat": (np.int32, ()),
    }


def _entry(name: str, world: World, size: int, most: int) -> Entry:
    return Entry(
        name,
        f"the task {world.task.name}: one row for each step and seat of an episode",
        (
            Field("observations", f"float32, (rows, {size})",
                  "the state before the step, as `State.vector()`: `columns` names its numbers"),
            Field("masks", f"bool, (rows, {most})",
                  "which of the seat's `actions` were valid then; a seat with fewer has false "
                  "behind them"),
            Field("actions", "int32", "the number of the seat's action that was applied in the "
                  "step: a place in its list of `actions`; -1: none was"),
            Field("own", "bool", "the action was the participant's; false: a stand-in's, or none"),
            Field("rewards", "float32", "1 in the step that reached the goal, else 0"),
            Field("terminations", "bool", "the goal was reached with the step"),
            Field("episode", "int64", "`episodes.id` of the catalogue"),
            Field("step", "int32", "its number, from 1 on"),
            Field("seat", "int32", "`seats.seat` of the catalogue"),
        ),
        layout_notes(world),
    )  # fmt: skip
