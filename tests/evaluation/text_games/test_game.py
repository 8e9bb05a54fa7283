"""Text games ask for a model's answers and rate them, whatever the answers are."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from robotouille import RobotouilleError, WrongArgumentError
from robotouille.replay import Recording
from robotouille_evaluation.agents.making import OWN_STRATEGIES
from robotouille_evaluation.models import ModelRequest, ScriptedModel
from robotouille_evaluation.packs import build_shift_pack
from robotouille_evaluation.runs import AgentSpec, EpisodeJob, RunContext, RunFolder, play_job
from robotouille_evaluation.text_games import GameOptions, TextGame, load_instance
from tests.support.pages import blocks


def game_of(task: str, options: GameOptions | None = None) -> TextGame:
    """Return a new game."""
    return TextGame(load_instance(task), options)


def plan_of(game: TextGame) -> list[str]:
    """Return the sentences of the known plan for one player."""
    return [action.sentence for step in game.instance.plan(game.world) for action in step]


def finish(game: TextGame, answer: str = "Do nothing") -> TextGame:
    """Give the same answer until the end."""
    while game.request is not None:
        game.answer(game.headed(answer))
    return game


def test_rewards_along_the_shortest_plan_add_up_to_one() -> None:
    game = game_of("synchronous/01")
    rewards = [game.answer(f"Action: {sentence}") for sentence in plan_of(game)]
    assert rewards == pytest.approx([1 / 8] * 8)
    assert game.request is None
    score = game.score
    assert (score.success, score.steps, score.optimality, score.reward) == (True, 8, 1, 1)


def test_undoing_a_step_costs_what_it_earned() -> None:
    game = game_of("synchronous/01")
    for sentence in plan_of(game)[:2]:
        assert game.answer(f"Action: {sentence}") == pytest.approx(1 / 8)
    assert game.answer("Action: Do nothing") == 0
    put_back = next(action for action in game.legal if not action.startswith(("Do", "Move")))
    assert game.answer(f"Action: {put_back}") == pytest.approx(-1 / 8)
    assert game.score.progress == pytest.approx(1 / 8)


def test_sparse_rewards_come_with_the_goal() -> None:
    game = game_of("synchronous/01", GameOptions(dense=False))
    rewards = [game.answer(f"Action: {sentence}") for sentence in plan_of(game)]
    assert rewards == [0] * 7 + [1]


@pytest.mark.parametrize(
    "answer",
    ["", " \n", "\ud800", "Action:", "Action: fly", "Action: " + "x" * 1_000_000, "[" * 1_000_000,
     '{"action": "Do nothing"}', "\x00", "Action: \x1b[2J"],
)  # fmt: skip
def test_unusable_answer_is_counted_and_changes_nothing(answer: str) -> None:
    game = game_of("synchronous/01")
    before = game.state
    assert game.answer(answer) == 0
    assert game.state is before
    assert game.feedback.startswith("The action ")
    for sentence in plan_of(game):
        game.answer(f"Action: {sentence}")
    score = game.score
    assert (score.success, score.malformed, score.answers) == (True, 1, 9)
    assert score.format == score.legal == pytest.approx(8 / 9)


def test_impossible_action_is_invalid_and_not_malformed() -> None:
    game = game_of("synchronous/01")
    game.answer("Action: Move robot1 from table1 to table2")
    game.answer("Action: Do nothing")
    score = game.score
    assert (score.invalid, score.malformed, score.format, score.legal) == (1, 0, 1, 0.5)


def test_model_without_usable_answers_gives_up() -> None:
    game = finish(game_of("synchronous/01"), "nonsense")
    assert (game.score.answers, game.score.ended) == (15, "feedback-limit")
    assert game.score.optimality == 0
    with pytest.raises(WrongArgumentError, match="the game is over"):
        game.answer("Do nothing")


def test_score_before_the_end() -> None:
    game = game_of("synchronous/01")
    game.answer("Action: Do nothing")
    assert (game.score.ended, game.score.success, game.score.steps) == (None, False, 1)
    assert game.score.as_json()["optimality"] == 0


@pytest.mark.parametrize("agent", OWN_STRATEGIES)
def test_every_strategy_plays_to_an_end(agent: str) -> None:
    game = game_of("synchronous/01", GameOptions(agent=agent, dense=False))
    answer = "Plan:\nDo nothing" if agent == "io" else "Action: Do nothing"
    for _ in range(100):
        if game.request is not None:
            game.answer(answer)
    assert game.score.ended in ("step-limit", "plan-exhausted")


@pytest.mark.parametrize(("control", "asked"), [("turns", 42), ("each", 42), ("joint", 21)])
def test_one_model_plays_a_team(control: str, asked: int) -> None:
    game = game_of("multi_agent/01", GameOptions(control=control, dense=False))
    answer = "Do nothing" if control != "joint" else "Actions:\nrobot1: wait\nrobot2: wait"
    if control == "joint":
        assert "robot2: Do nothing" in game.legal
    score = finish(game, answer).score
    assert (score.answers, score.steps, score.malformed) == (asked, 21, 0)


def test_players_with_conversations_of_their_own_are_asked_in_turn() -> None:
    game = game_of("multi_agent/01", GameOptions(control="each", dense=False))
    players = []
    for _ in range(4):
        players.append(game.player)
        assert game.text.startswith(f"You are {game.player}.")
        game.answer("Action: Do nothing")
    assert players == ["robot1", "robot2"] * 2


def test_team_makes_progress_along_its_plan() -> None:
    game = game_of("multi_agent/01", GameOptions(control="joint"))
    steps = [
        [f"{action.arguments[0]}: {action.sentence}" for action in step]
        for step in game.instance.plan(game.world)
    ]
    # A model's actions must be possible before the step; some of the plan's are not.
    for lines in itertools.takewhile(lambda lines: set(lines) <= set(game.legal), steps):
        assert game.answer("\n".join(["Actions:", *lines])) == pytest.approx(1 / 14)
    assert game.score.steps >= 3


@pytest.mark.slow
def test_planner_partner_works_next_to_an_idle_model() -> None:
    game = finish(game_of("multi_agent/01", GameOptions(partner="planner")))
    assert game.score.answers == game.score.steps
    assert (game.score.progress or 0) > 0


async def test_shift_is_rated_as_in_the_benchmark(tmp_path: Path) -> None:
    """A model that gives up lets the remaining orders expire."""
    job = EpisodeJob(
        agent=AgentSpec(name="m", kind="model", strategy="react-full", model="m"),
        instance="shifts/01_sandwich_bar/default",
        seats=1,
        seed=0,
        budget="shift",
        variant="",
    )
    folder = RunFolder(tmp_path)
    model = ScriptedModel(lambda _: "nonsense")
    row = await play_job(job, RunContext("r", build_shift_pack(), folder), model)
    assert row.score is not None
    score = finish(game_of("shifts/01"), "nonsense").score
    assert (score.points, score.malformed) == (row.score.points, row.counts.malformed)
    assert score.share == score.reward == score.points / row.score.planner
    assert (score.progress, score.optimality, score.success) == (None, None, False)


def test_requests_are_those_of_the_benchmark_and_grow() -> None:
    game = game_of("synchronous/01")
    first = game.request
    assert isinstance(first, ModelRequest)
    assert [each.role for each in first.messages[:2]] == ["system", "user"]
    game.answer("Action: Do nothing")
    assert game.request is not None
    assert game.request.messages[: len(first.messages)] == first.messages
    assert len(game.request.messages) == len(first.messages) + 2


def test_recording_has_the_answers() -> None:
    game = game_of("synchronous/01")
    game.answer("Action: fly")
    game.answer("Action: Do nothing")
    recording = Recording(game.recording())
    assert recording.verify().ok
    assert game.request is None


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"agent": "reactfull"}, "did you mean 'react-full'"),
        ({"control": "alone"}, "unknown control 'alone'"),
        ({"partner": "friend"}, "expected one of '', 'planner'"),
    ],
)
def test_unknown_option_says_what_is_possible(options: dict[str, str], why: str) -> None:
    with pytest.raises(WrongArgumentError, match=why):
        GameOptions(**options)


def test_strategy_without_team_prompt_is_refused() -> None:
    with pytest.raises(RobotouilleError, match="starts again after a failure"):
        game_of("multi_agent/01", GameOptions(agent="reflexion"))


def test_example_of_the_guide_runs() -> None:
    (example,) = blocks("training_hubs.md", "python")
    exec(example, {"print": lambda *_: None})
