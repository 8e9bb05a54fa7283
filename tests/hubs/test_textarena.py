"""TextArena makes and plays the registered games, for one player and for teams."""

from __future__ import annotations

import importlib.util
from typing import Any

import pytest

from robotouille import RobotouilleError, World, task_names
from robotouille_evaluation.text_games import load_instance
from tests.support.pages import blocks

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("robotouille_textarena") is None,
        reason="robotouille-textarena is not installed",
    ),
    # Libraries that TextArena imports.
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


def made(name: str, **options: Any) -> Any:
    """Return a registered game."""
    import textarena

    import robotouille_textarena  # noqa: F401

    return textarena.make(name, **options)


def first_action(observation: str) -> str:
    """Return the first possible action of the last observation."""
    return observation.rpartition("Valid Actions:\n")[2].partition("\n")[0]


def test_one_player_reaches_the_goal() -> None:
    instance = load_instance("synchronous/01")
    plan = [action.sentence for step in instance.plan(World(instance.task)) for action in step]
    env = made("Robotouille-v0-synchronous-01")
    env.reset(num_players=1)
    player, observation = env.get_observation()
    assert player == 0
    assert "Answer in exactly this form" in observation
    done, info = env.step("I would like to fly.")
    assert (done, info["reward"]) == (False, 0)
    assert "The action was malformed" in env.get_observation()[1]
    # The forms of a move: as the prompt asks, TextArena's brackets, and the action alone.
    forms = ("Reasoning: a plan\nAction: {}", "I go. [{}]", "{}")
    for number, sentence in enumerate(plan):
        assert not done
        done, info = env.step(forms[number % 3].format(sentence))
    assert done
    assert info["score"]["optimality"] == 1
    rewards, game_info = env.close()
    assert rewards == {0: 1}
    assert game_info[0]["turn_count"] == len(plan)
    assert game_info[0]["reason"] == f"goal after {len(plan)} of 12 steps"


def test_players_of_a_team_act_in_turn_and_share_the_reward() -> None:
    env = made("Robotouille-v0-multi_agent-01-train")
    env.reset(num_players=2, seed=1000)
    asked, done = [], False
    while not done:
        player, observation = env.get_observation()
        assert f"robot{player + 1}" in first_action(observation) or "Do nothing" in observation
        asked.append(player)
        done, _ = env.step(f"Action: {first_action(observation)}")
    assert asked[:4] == [0, 1, 0, 1]
    rewards, game_info = env.close()
    assert rewards[0] == rewards[1] <= 1
    assert game_info[0]["reason"].startswith("step-limit")


def test_planner_plays_the_other_seats() -> None:
    env = made("Robotouille-v0", task="multi_agent/01", partner="planner")
    env.reset(num_players=1)
    for _ in range(3):
        player, _ = env.get_observation()
        assert player == 0
        env.step("[Do nothing]")
    assert "robot2" in env.get_board_str()
    with pytest.raises(RobotouilleError, match="1 player, not 2"):
        env.reset(num_players=2)


@pytest.mark.parametrize("answer", ["", "[", "x" * 1_000_000, "[" * 100_000, "\ud800", '{"a": [}'])
def test_unusable_answer_changes_nothing(answer: str) -> None:
    env = made("Robotouille-v0-synchronous-01-raw")
    env.reset(num_players=1)
    before = env.get_board_str()
    assert env.step(answer) == (False, {"reward": 0})
    assert env.get_board_str() == before


def test_wrong_arguments_say_what_is_wrong() -> None:
    with pytest.raises(RobotouilleError, match="no task"):
        made("Robotouille-v0", task="synchronous/soop").reset(num_players=1)
    env = made("Robotouille-v0-synchronous-01")
    with pytest.raises(RobotouilleError, match="call reset first"):
        env.step("Do nothing")
    with pytest.raises(RobotouilleError, match="seats"):
        env.reset(num_players=3)
    with pytest.raises(RobotouilleError, match="is not an instance"):
        env.reset(num_players=1, seed=-1)


def test_every_shipped_task_is_registered() -> None:
    from textarena.envs.registration import ENV_REGISTRY

    from robotouille_textarena import env_id, register_games

    register_games()  # Registering again is harmless.
    names = [n for n in task_names() if n.startswith(("sync", "async", "multi", "shifts"))]
    assert len(names) == 36
    assert {env_id(name) for name in names} <= set(ENV_REGISTRY)


def test_example_of_the_readme_runs() -> None:
    (example,) = blocks("../packages/robotouille-textarena/README.md", "python")
    exec(example, {"print": lambda *_: None})
