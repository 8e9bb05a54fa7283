"""Minari data sets, one per task and seat."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import minari
import numpy as np
from gymnasium import spaces
from minari.data_collector import EpisodeBuffer

from robotouille.errors import SlotOverflowError, UnknownNameError
from robotouille.world.world import World
from robotouille_data.exports.arrays import NOTHING, action_number, layout_notes
from robotouille_data.exports.observed import Observed
from robotouille_data.exports.recorded import SimulatedEpisode, replays
from robotouille_data.exports.request import ExportEntry, Field, Part, WrittenFile

FOLDER_VARIABLE = "MINARI_DATASETS_PATH"
MAX_STEPS = 20_000
"""Longest episode. Minari holds a whole episode in memory."""
FLOAT_BYTES = 4
MAX_BYTES = 64 * 1024 * 1024
"""Limit on the observations and masks of an episode, of all seats. Minari takes some eighteen times
this memory. A whole shift of the largest kitchen, `shifts/03` with three seats, has 58 MiB."""


@dataclass(slots=True)
class SeatSet:
    """Data set of one seat that grows episode by episode."""

    name: str
    world: World
    seat: int
    dataset: Any = None
    steps: int = 0
    actions: int = 0
    rewards: float = 0.0

    def add(self, replay: SimulatedEpisode, buffer: EpisodeBuffer) -> None:
        """Add an episode."""
        if self.dataset is None:
            self.dataset = minari.create_dataset_from_buffers(
                self.name,
                [buffer],
                observation_space=_observation_space(self.world, self.seat),
                action_space=spaces.Discrete(_actions(self.world, self.seat) + 1),
                description=f"Seat {self.seat} of {self.world.task.name}, in Robotouille.",
                data_format="parquet",
            )
        else:
            self.dataset.update_dataset_from_buffer([buffer])
        number = self.dataset.storage.total_episodes - 1
        told = {"episode": replay.episode_id, "seat": self.seat, "reason": replay.reason}
        self.dataset.storage.update_episode_metadata([told], [number])
        self.steps += len(buffer)
        self.actions += int(np.sum(buffer.actions))
        self.rewards += float(np.sum(buffer.rewards))


def write_minari(part: Part) -> Iterator[WrittenFile]:
    """Write one data set per task and seat into the part's folder."""
    with _datasets_in(part.folder):
        for digest, its in groupby(replays(part), key=lambda replay: replay.task.digest):
            yield from _write_task(part, part.tasks[digest], its)


@contextmanager
def _datasets_in(folder: Path) -> Iterator[None]:
    """Make Minari use another folder.

    Minari's warnings are hidden: they ask for a Gymnasium environment, but each data set is
    one seat of a team, which is not an environment by itself.
    """
    before = os.environ.get(FOLDER_VARIABLE)
    os.environ[FOLDER_VARIABLE] = str(folder.absolute())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        if before is None:
            del os.environ[FOLDER_VARIABLE]
        else:
            os.environ[FOLDER_VARIABLE] = before


def _write_task(
    part: Part, task: str, episodes: Iterator[SimulatedEpisode]
) -> Iterator[WrittenFile]:
    sets: list[SeatSet] = []
    for replay in episodes:
        world = replay.world
        sets = sets or [
            SeatSet(f"robotouille/{task}-seat{seat}-v0", world, seat)
            for seat in range(len(world.players))
        ]
        if fault := _fault(replay):
            part.faults[replay.episode_id] = fault
            continue
        try:
            # All seats before the first is added, so that the data sets of a task have the same
            # episodes.
            buffers = [_buffer(replay, seat) for seat in range(len(world.players))]
        except (SlotOverflowError, UnknownNameError) as error:
            part.faults[replay.episode_id] = str(error)
            continue
        for each, buffer in zip(sets, buffers, strict=True):
            each.add(replay, buffer)
    for each in (each for each in sets if each.dataset is not None):
        part.codebook[each.name] = _entry(each)
        sums = {"actions": each.actions, "rewards": each.rewards}
        yield WrittenFile(each.name, part.path(part.folder / each.name), each.steps, sums)


def _fault(replay: SimulatedEpisode) -> str:
    """Return why Minari cannot hold an episode, or nothing."""
    if not 0 < len(replay.moments) <= MAX_STEPS:
        return f"no steps, or more than {MAX_STEPS:,}"
    world = replay.world
    row = sum(
        FLOAT_BYTES * world.encoding.size + _actions(world, seat) + 1
        for seat in range(len(world.players))
    )
    size = row * (len(replay.moments) + 1)
    if size > MAX_BYTES:
        return f"{size / 2**20:,.0f} MiB of observations; at most {MAX_BYTES >> 20} MiB"
    return ""


def _buffer(replay: SimulatedEpisode, seat: int) -> EpisodeBuffer:
    player, moments = replay.world.players[seat], replay.moments
    nothing = _actions(replay.world, seat)
    states = [replay.world.initial, *(moment.after for moment in moments)]
    seen = [replay.observed(state, player) for state in states]
    numbers = [action_number(moment, player) for moment in moments]
    own = [player in moment.moves and moment.moves[player].own for moment in moments]
    ends = [moment.terminates for moment in moments]
    return EpisodeBuffer(
        observations={
            "observation": np.stack([each.vector() for each in seen]),
            "action_mask": np.stack([_mask(each) for each in seen]),
        },
        # Discrete spaces begin at 0, so doing nothing is the number after the last action and not
        # -1 as in the arrays.
        actions=[nothing if number == NOTHING else number for number in numbers],
        rewards=[moment.reward for moment in moments],
        terminations=ends,
        truncations=[*([False] * (len(moments) - 1)), not ends[-1]],
        # Minari requires an info for each observation, of which there is one more than actions.
        infos={"own": [*own, False]},
    )


def _mask(observed: Observed) -> Any:
    """Return the mask of valid actions. Its last element, doing nothing, is always true."""
    return np.append(observed.mask(), True).astype(np.int8)


def _actions(world: World, seat: int) -> int:
    return len(world.ground_actions(world.players[seat]))


def _observation_space(world: World, seat: int) -> spaces.Dict:
    encoding = world.encoding
    return spaces.Dict({
        "observation": spaces.Box(-1.0, encoding.high, (encoding.size,), np.float32),
        "action_mask": spaces.MultiBinary(_actions(world, seat) + 1),
    })  # fmt: skip


def _entry(each: SeatSet) -> ExportEntry:
    world, nothing = each.world, _actions(each.world, each.seat)
    return ExportEntry(
        each.name,
        f"the task {world.task.name} for seat {each.seat}; rows are steps",
        (
            Field("observations.observation", f"float32, ({world.encoding.size},)",
                  "state, as `State.vector()`; `columns` names its elements"),
            Field("observations.action_mask", f"int8, ({nothing + 1},)",
                  "valid `actions` of the seat; the last element is doing nothing"),
            Field("actions", "int64",
                  f"applied action, as an index of the seat's `actions`; {nothing}: none"),
            Field("rewards", "float64", "points of a shift, or 1 in the step to the goal"),
            Field("terminations", "bool", "the step reached the goal, or ended the shift"),
            Field("truncations", "bool", "the episode ended with the step but without the goal"),
            Field("infos.own", "bool", "true if the participant chose the action; false for a "
                  "substitute or no action"),
        ),
        {**layout_notes(world), "seat": each.seat},
    )  # fmt: skip
