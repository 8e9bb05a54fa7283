"""Interface of `BatchWorld`: shapes, resets, overflow, threads, wrong arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robotouille import UnknownNameError, World, WrongArgumentError, WrongWorldError
from robotouille.batch import BatchWorld
from robotouille.errors import RobotouilleError
from tests.batch.agreement import world_of

WORLD = World("multi_agent/01_lettuce_burger")


def played(steps: int, **options: Any) -> BatchWorld:
    batch = BatchWorld(WORLD, 6, **options)
    for _ in range(steps):
        batch.step(batch.random_actions())
    return batch


def test_same_seed_gives_same_steps_with_any_number_of_threads() -> None:
    one, other = played(10, seed=4), played(10, seed=4, threads=3)
    assert np.array_equal(one.rows, other.rows)
    assert np.array_equal(one.masks("robot2"), other.masks("robot2"))
    assert not np.array_equal(one.rows, played(10, seed=5).rows)


def test_copies_are_reset_by_mask() -> None:
    batch = played(5)
    before = batch.vectors()
    mask = np.arange(6) % 2 == 0
    batch.reset(mask)
    assert np.array_equal(batch.vectors()[~mask], before[~mask])
    assert np.array_equal(batch.vectors()[mask], np.tile(WORLD.initial.vector(), (3, 1)))
    batch.reset()
    assert batch.state(1) == WORLD.initial


def test_states_can_be_kept_and_restored() -> None:
    batch = played(5)
    kept, vectors = batch.rows.copy(), batch.vectors()
    batch.step(batch.random_actions())
    batch.rows[:] = kept
    assert np.array_equal(batch.vectors(), vectors)


def test_no_action_is_neither_applied_nor_rejected() -> None:
    batch = played(0)
    result = batch.step(np.full((6, 2), -1))
    assert not result.applied.any()
    assert batch.state(0) == WORLD.initial


def test_one_player_needs_no_second_axis() -> None:
    batch = BatchWorld(World("synchronous/01"), 2)
    assert batch.step(batch.random_actions()[:, 0]).applied.tolist() == [[True], [True]]


@pytest.mark.parametrize(
    "actions",
    [
        np.full((6, 2), -2),
        np.full((6, 2), 10**6),
        np.zeros((6, 3), dtype=np.int64),
        np.zeros((6, 2)),
        np.full((6, 2), np.nan),
    ],
)
def test_wrong_actions_change_nothing(actions: Any) -> None:
    batch = played(2)
    before = batch.rows.copy()
    with pytest.raises(WrongArgumentError):
        batch.step(actions)
    assert np.array_equal(batch.rows, before)


def test_wrong_arguments_raise() -> None:
    batch = played(0)
    with pytest.raises(UnknownNameError, match="did you mean 'robot1'"):
        batch.masks("robot11")
    with pytest.raises(WrongArgumentError, match="6 booleans"):
        batch.reset(np.zeros(6))
    with pytest.raises(WrongWorldError):
        batch.set_state(0, World("synchronous/01").initial)
    with pytest.raises(WrongArgumentError):
        BatchWorld(WORLD, 0)
    with pytest.raises(RobotouilleError, match="play cannot create objects of kind 'cake'"):
        BatchWorld(WORLD, 1, slots={"cake": 3})


def test_joint_masks_and_valid_agree_with_masks() -> None:
    for batch in (played(7), played(7, threads=3), BatchWorld(World("asynchronous/06"), 3)):
        masks = [batch.masks(player) for player in batch.players]
        assert np.array_equal(batch.joint_masks(), np.concatenate(masks, axis=1))
        assert batch.valid(batch.random_actions()).all()
        for number in range(min(batch.action_counts)):
            actions = np.full((batch.copies, len(batch.players)), number)
            expected = np.stack([mask[:, number] for mask in masks], axis=1)
            assert np.array_equal(batch.valid(actions), expected)
        assert not batch.valid(np.full_like(actions, -1)).any()
        with pytest.raises(WrongArgumentError, match="found number"):
            batch.valid(np.full_like(actions, 10**6))


def test_second_player_on_one_place_is_rejected() -> None:
    """Both players walk to one place, which has room for one player."""
    batch = played(0)
    masks = [batch.masks(player)[0] for player in batch.players]
    places = [
        {WORLD.ground_actions(player)[n].arguments[-1]: n for n in np.flatnonzero(mask).tolist()
         if WORLD.ground_actions(player)[n].name == "move"}
        for player, mask in zip(batch.players, masks, strict=True)
    ]  # fmt: skip
    place = min(places[0].keys() & places[1].keys())
    actions = np.tile([places[0][place], places[1][place]], (6, 1))
    assert batch.valid(actions).all()
    assert batch.step(actions).applied[0].tolist() == [True, False]


def overflowing(**options: Any) -> tuple[BatchWorld, int]:
    """Return a batch with one slot for bolts and a copy that has just created two."""
    batch = BatchWorld(world_of("workshop/01"), 40, slots={"bolt": 1}, **options)
    while True:
        lost = batch.step(batch.random_actions()).overflowed
        if lost.any():
            return batch, int(np.flatnonzero(lost)[0])


def test_copy_with_too_few_slots_stands_still() -> None:
    batch, lost = overflowing()
    assert batch.overflowed[lost]
    before = batch.rows[lost].copy()
    result = batch.step(batch.random_actions())
    assert not result.applied[lost].any()
    assert not result.terminated[lost]
    assert np.array_equal(batch.rows[lost], before)
    with pytest.raises(WrongArgumentError, match="overflowed"):
        batch.state(lost)
    batch.reset(batch.overflowed)
    assert not batch.overflowed.any()
    assert batch.state(lost) == batch.world.initial


def test_automatic_reset() -> None:
    batch, lost = overflowing(auto_reset=True)
    assert not batch.overflowed.any()
    assert batch.state(lost) == batch.world.initial
    assert batch.step(batch.random_actions()).applied[lost].all()


def test_arrays_of_another_shape_raise() -> None:
    """Kernels do not check bounds: rows of another world would crash the process."""
    team, alone = BatchWorld(World("multi_agent/01"), 3), BatchWorld(World("synchronous/01"), 3)
    for shape in ((2, 3), (6,), (1, 3, 2)):
        with pytest.raises(WrongArgumentError, match=r"shape \(3, 2\)"):
            team.step(np.zeros(shape, dtype=np.int64))
    alone.step(np.full(3, -1))
    for rows in (alone.rows, team.rows[:2], team.rows.astype(np.int32), None):
        with pytest.raises(WrongArgumentError, match="expected rows of int64"):
            team.rows = rows  # type: ignore[assignment]
    team.rows = team.rows.copy()


def test_missing_compiler_is_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World("training/01")
    BatchWorld(world, 1)  # ROBOTOUILLE_COMPILE=0 in tests hides the warning.
    monkeypatch.setattr("robotouille.compiling.COMPILED", False)
    monkeypatch.delenv("ROBOTOUILLE_COMPILE")
    with pytest.warns(RuntimeWarning, match=r"300 times slower .* 'robotouille\[fast\]'"):
        BatchWorld(world, 1)
