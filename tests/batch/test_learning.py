"""Training on the JAX engine: what networks see, the shaped reward, and a whole short run."""

from __future__ import annotations

import csv
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from robotouille import World, load_certificate
from robotouille.planning.plan import read_plan

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("robotouille_jax") is None
    or importlib.util.find_spec("optax") is None,
    reason="robotouille-jax[train] is not installed",
)


def test_each_seat_sees_its_own_player_in_the_same_place() -> None:
    from robotouille_jax.learning.views import views

    world = World("training/03@2")
    first, second = views(world.encoding, world.players).columns
    names = world.encoding.columns
    place = names.index("nothing(robot1)")
    assert first[place] == place
    assert names[second[place]] == "nothing(robot2)"
    assert sorted(second) == sorted(first)


def test_seats_that_cannot_be_exchanged_see_the_same() -> None:
    from robotouille_jax.learning.views import views

    world = World("shifts/04_counter@2")
    first, second = views(world.encoding, world.players).columns
    assert first.tolist() == second.tolist() == list(range(world.encoding.size))


def test_progress_of_the_shaped_reward_is_zero_at_the_goal_alone() -> None:
    from robotouille.batch.rules import CompiledRules
    from robotouille_jax.goal_progress import progress_of

    world = World("training/03@2")
    rules = CompiledRules(world)
    progress = progress_of(rules.goal, len(rules.encoding.atoms))
    plan = read_plan("\n".join(load_certificate("training/03@2").plan), world)
    state, found = world.initial, []
    for step in plan:
        found.append(float(progress(state.vector()[: len(rules.encoding.atoms)] == 1)))
        state = state.step(step).state
    assert state.goal_reached
    assert float(progress(state.vector()[: len(rules.encoding.atoms)] == 1)) == 0
    assert max(found) < 0
    assert found[0] < found[-1]


def test_starts_along_a_plan_end_one_step_before_the_goal() -> None:
    from robotouille_jax.learning.starts import start_states

    world = World("training/03@2")
    states = start_states(world, "plan")
    plan = read_plan("\n".join(load_certificate("training/03@2").plan), world)
    assert states[0] == world.initial
    assert len(states) == len(plan)
    assert not any(state.goal_reached for state in states)
    assert states[-1].step(plan.steps[-1]).state.goal_reached
    assert start_states(world, "first") == [world.initial]


def test_episodes_start_along_the_plan_and_at_last_in_the_first_state() -> None:
    import jax
    import jax.numpy as jnp

    from robotouille_jax.learning.starts import REHEARSING, draw_origins

    draw = jax.jit(draw_origins, static_argnums=(0, 3))
    found = np.asarray(draw(6, jnp.float32(1), jax.random.key(1), 128))
    assert set(found[::REHEARSING]) == {0}
    assert set(found) == set(range(6))
    assert not np.asarray(draw(6, jnp.float32(0.25), jax.random.key(1), 128)).any()


def test_draws_follow_the_logits_and_never_take_an_invalid_action() -> None:
    import jax
    import jax.numpy as jnp

    from robotouille_jax.learning.ppo import drawn

    logits = jnp.array([-1e9, 0.0, jnp.log(3.0), -1e9, -200.0])
    found = np.asarray(drawn(jnp.tile(logits, (4000, 1)), jax.random.key(1)))
    counts = np.bincount(found, minlength=5)
    assert counts[[0, 3, 4]].sum() == 0
    assert 0.7 < counts[2] / 4000 < 0.8


def test_curves_have_means_and_intervals_over_seeds(tmp_path: Path) -> None:
    from robotouille_jax.learning.curves import RunCurves, write_curves

    goals = np.repeat([[0.0], [1.0], [0.5]], 10, axis=1)
    goals[2, 5:] = np.nan
    short = RunCurves("task", "IPPO", np.arange(3.0), {"goals": goals[:, :3]})
    write_curves(tmp_path / "short.csv", [short])
    (point,) = csv.DictReader((tmp_path / "short.csv").read_text().splitlines())
    assert (point["steps"], point["seeds"]) == ("2", "3")
    path = tmp_path / "curves.csv"
    write_curves(path, [RunCurves("task", "IPPO", np.arange(10.0), {"goals": goals})])
    first, second = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    assert (first["steps"], first["mean"], first["seeds"]) == ("4", "0.5000", "3")
    assert 0 <= float(first["low"]) < 0.5 < float(first["high"]) <= 1
    assert (second["mean"], second["seeds"]) == ("0.5000", "2")


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["no_such@2"], "no_such"),
        (["training/03@2", "--algorithms", "ippo,qmix"], "unknown algorithm 'qmix'"),
        (["training/03@2", "--minibatches", "3"], "must be a multiple of minibatches, 3"),
        (["training/03@2", "--copies", "0"], "start at 1"),
        (["workshop/02@2", "--starts", "plan"], "certificate"),
        (["shifts/06_rush_hour@2"], "does not support shifts in which objects are created"),
    ],
)
def test_wrong_requests_get_one_line(
    words: list[str], why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from robotouille_jax.learning.__main__ import main

    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert why in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_help_explains_each_option() -> None:
    from robotouille_jax.learning.__main__ import _parser

    assert all(action.help for action in _parser()._actions)
    words = " ".join(_parser().format_help().split())
    assert "steps of each copy between updates of the networks (default: 16)" in words


@pytest.mark.slow
def test_a_short_run_writes_curves_and_weights(tmp_path: Path) -> None:
    from robotouille_jax.learning.__main__ import main

    sizes = "--horizon 4 --copies 4 --rollout 4 --updates 5 --hidden 8 --seeds 1"
    assert main(["training/03@2", "--out", str(tmp_path), "--starts", "plan", *sizes.split()]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [
        "training_03_curves.csv",
        "training_03_curves.png",
        "training_03_ippo_0.npz",
        "training_03_mappo_0.npz",
    ]


@pytest.mark.slow
def test_a_run_too_short_for_an_episode_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from robotouille_jax.learning.__main__ import main

    sizes = "--algorithms ippo --copies 2 --rollout 2 --updates 2 --hidden 4 --seeds 2"
    words = ["training/03@2", "--out", str(tmp_path), "--no-picture", *sizes.split()]
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "ippo last 10 rollouts, goals of each seed: - -" in shown
    assert "no episode from the task's first state ended" in shown
    assert "nan" not in shown
    assert f"robotouille cross-play training/03@2 {tmp_path}/*.npz" in shown


def test_a_file_in_place_of_the_results_is_named_before_the_training(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from robotouille_jax.learning.__main__ import main

    (tmp_path / "out").touch()
    assert main(["training/03@2", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error == f"robotouille-train: --out: {tmp_path / 'out'} is a file; expected a folder\n"
