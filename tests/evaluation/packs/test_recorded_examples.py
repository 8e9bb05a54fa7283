"""Recorded episodes as in-context examples: their choices, and what models are sent."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robotouille import GroundAction, World, load_task
from robotouille.episode import Clock, Episode, Rules
from robotouille.errors import RobotouilleError, UnknownNameError
from robotouille.installation import data_folder
from robotouille.planning import read_plan
from robotouille.replay import Recording, read_recording
from robotouille_client.cli.main import app
from robotouille_evaluation.agents.making import PAPER_REACT, make_strategy
from robotouille_evaluation.agents.proposal import AgentObservation
from robotouille_evaluation.models import ModelRequest
from robotouille_evaluation.packs import read_pack, recorded_examples
from robotouille_evaluation.packs.example_episodes import ExampleChoice
from robotouille_evaluation.packs.recorded_examples import recorded_choices
from robotouille_evaluation.packs.store import write_pack
from tests.support.games import Choose, play_through, random_choice, record
from tests.support.runs import small_pack

SOUP = "asynchronous/06_potato_soup"
SANDWICH = "synchronous/02_lettuce_sandwich"
TEAM = "multi_agent/01_lettuce_burger"
PAUSE = 40
"""Steps from one action of a player to the next, in which food is done."""


def plan_of(task: str, seats: str = "") -> list[tuple[GroundAction, ...]]:
    path = data_folder("problems") / f"{task}{seats}.plan"
    return [*read_plan(path.read_text(encoding="utf-8"), World(load_task(task)))]


@pytest.fixture
def base(tmp_path: Path) -> Path:
    """Return the folder of a pack with two tasks."""
    write_pack(small_pack(SANDWICH, SOUP), tmp_path / "base")
    return tmp_path / "base"


def hesitant(task: str) -> Choose:
    """Return a player who carries out a plan, with a long pause before each of its steps."""
    left = [action for joint in plan_of(task) for action in joint]
    calls = 0

    def choose(episode: Episode, player: str) -> GroundAction | None:
        nonlocal calls
        calls += 1
        if not left or calls % PAUSE:
            return None
        action = left.pop(0)
        return episode.world.action(action.name, *action.arguments)

    return choose


def together(task: str) -> Choose:
    """Return a team that carries out a plan."""
    plan = plan_of(task, "@2")

    def choose(episode: Episode, player: str) -> GroundAction | None:
        mine = [action for action in plan[episode.step] if action.player == player]
        return episode.world.action(mine[0].name, *mine[0].arguments) if mine else None

    return choose


def played(task: str, choose: Choose, timing: str = "benchmark") -> bytes:
    rules = Rules(clock=Clock.LOCKSTEP, max_steps=2000)
    return record(*play_through(task, rules, choose, timing=timing))


def recording_of(task: str, timing: str = "benchmark") -> Recording:
    return Recording(played(task, hesitant(task), timing))


def replayed(choices: list[ExampleChoice]) -> bool:
    state = choices[0].state.world.initial
    for choice in choices:
        assert choice.state == state
        state = state.step(choice.action).state
    return state.goal_reached


@pytest.mark.parametrize("timing", ["benchmark", "people"])
@pytest.mark.parametrize("task", [SANDWICH, SOUP])
def test_pauses_are_left_out_and_the_goal_is_reached(task: str, timing: str) -> None:
    recording = recording_of(task, timing)
    choices = recorded_choices(recording)
    assert replayed(choices)
    assert len(choices) <= 1.5 * len(plan_of(task)) < recording.length


def test_games_with_limited_sight_are_no_examples() -> None:
    rules = Rules(clock=Clock.LOCKSTEP, max_steps=2000, sight=1)
    recording = Recording(record(*play_through(SANDWICH, rules, hesitant(SANDWICH))))
    with pytest.raises(RobotouilleError, match="saw a part of the kitchen only"):
        recorded_choices(recording)


def test_waits_stay_where_the_kitchen_needs_them() -> None:
    choices = recorded_choices(recording_of(SOUP))
    sentences = [choice.action.sentence for choice in choices]
    boiling = next(i for i, words in enumerate(sentences) if words.startswith("Start boiling"))
    assert sentences[boiling + 1] == "Do nothing"
    assert "Do nothing" not in sentences[:boiling]


def test_reasoning_names_the_next_actions_if_none_is_recorded() -> None:
    first, second, *_ = recorded_choices(recording_of(SANDWICH))
    assert first.reasoning.startswith("My next steps are: ")
    assert first.action.sentence in first.reasoning
    assert second.action.sentence in first.reasoning


def test_team_needs_a_seat() -> None:
    recording = Recording(played(TEAM, together(TEAM)))
    with pytest.raises(UnknownNameError, match="several seats; choose --seat robot1 or robot2"):
        recorded_choices(recording)
    choices = recorded_choices(recording, "robot2")
    assert {choice.action.player for choice in choices} == {"robot2"}


@pytest.mark.slow
def test_failed_episode_is_no_example() -> None:
    recording = Recording(played(SANDWICH, random_choice(1)))
    with pytest.raises(RobotouilleError, match="does not reach the goal"):
        recorded_choices(recording)


def test_example_of_very_many_actions_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_examples, "MAX_ACTIONS", len(plan_of(SANDWICH)) - 1)
    with pytest.raises(RobotouilleError, match="too many for an example"):
        recorded_choices(recording_of(SANDWICH))


def test_pauses_stay_where_leaving_them_out_takes_too_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each pause is left out by a replay of the whole game: hours for the longest recordings."""
    recording, shortest = recording_of(SOUP), len(recorded_choices(recording_of(SOUP)))
    monkeypatch.setattr(recorded_examples, "MAX_STEPS", 100)
    choices = recorded_choices(recording)
    assert replayed(choices)
    assert len(choices) > shortest
    monkeypatch.setattr(recorded_examples, "MAX_STEPS", 10)
    with pytest.raises(RobotouilleError, match="do not reach the goal without its pauses"):
        recorded_choices(recording)


def robotouille(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [*map(str, words)])


def first_request(folder: Path, dataset: str) -> ModelRequest:
    world = World(SANDWICH)
    strategy = make_strategy(read_pack(folder), PAPER_REACT, dataset)
    actions = tuple(each.sentence for each in world.initial.actions("robot1"))
    request = next(strategy.propose(AgentObservation(world.initial.text_view("robot1"), actions)))
    assert isinstance(request, ModelRequest)
    return request


def test_models_are_sent_the_recorded_episode(tmp_path: Path, base: Path) -> None:
    file, pack = tmp_path / "ada.rbt", tmp_path / "mine"
    file.write_bytes(played(SANDWICH, hesitant(SANDWICH), "people"))
    choices = recorded_choices(read_recording(file))

    result = robotouille(
        "benchmark", "examples", file, "--pack", base, "--out", pack, "--datasets", "synchronous"
    )
    assert result.exit_code == 0, result.output
    assert f"{SANDWICH} is also a task of the pack" in result.stderr

    sent = [message.content for message in first_request(pack, "synchronous").messages]
    start = sent.index(choices[0].state.text_view("robot1"))
    answers = sent[start + 1 : start + 2 * len(choices) : 2]
    assert [answer.partition("Action: ")[2] for answer in answers] == [
        choice.action.sentence for choice in choices
    ]
    other = [message.content for message in first_request(pack, "asynchronous").messages]
    assert answers[0] not in other


def test_plans_of_single_players_become_examples_of_all_forms(tmp_path: Path, base: Path) -> None:
    file, pack = tmp_path / "ada.rbt", tmp_path / "mine"
    file.write_bytes(played(SANDWICH, hesitant(SANDWICH)))
    assert robotouille("benchmark", "examples", file, "--pack", base, "--out", pack).exit_code == 0
    found = read_pack(pack)
    assert found.name == "mine"
    for form in ("react", "io", "io-cot"):
        (episode,) = found.example_set(f"multi_agent/{form}").episodes
        assert episode.name == "ada"


def test_unknown_dataset_is_named(tmp_path: Path, base: Path) -> None:
    file = tmp_path / "ada.rbt"
    file.write_bytes(played(SANDWICH, hesitant(SANDWICH)))
    words = (
        "benchmark",
        "examples",
        file,
        "--pack",
        base,
        "--out",
        tmp_path / "x",
        "--datasets",
        "synchron",
    )
    result = robotouille(*words)
    assert result.exit_code == 1
    assert "unknown data set 'synchron'; did you mean 'synchronous'?" in result.output
