"""The mock model: the same conversation, the same answers."""

from __future__ import annotations

import asyncio
from collections import Counter
from functools import cache

import pytest

from robotouille import World, load_task
from robotouille_evaluation.agents import Observation
from robotouille_evaluation.agents.making import OWN_STRATEGIES, own_strategy, team_strategy
from robotouille_evaluation.agents.proposal import Exchange, Proposal
from robotouille_evaluation.agents.teams.joint import Joint
from robotouille_evaluation.models import (
    AnswerForm,
    AnswerKind,
    Completion,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    ScriptedModel,
    SeededAnswers,
    Usage,
)
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack

ACTIONS = ("Move robot1 from table1 to stove1", "Pick up patty1 from table1 using robot1")


@cache
def own_pack() -> Pack:
    return build_own_pack()


def request(words: str = "") -> ModelRequest:
    observation = f"{words}\nValid Actions:\n" + "\n".join(ACTIONS) + "\n\nGoal: a burger"
    return ModelRequest((Message("user", observation),))


async def test_a_list() -> None:
    full = ModelError(ModelErrorKind.CONTEXT_OVERFLOW, "scripted")
    model = ScriptedModel.of(["two words", Completion("x", attempts=3), full])
    answer = await model.complete(request())
    assert answer.text == "two words" and answer.usage == Usage(18, 2)
    assert (await model.complete(request())).attempts == 3
    with pytest.raises(ModelError, match="context-overflow"):
        await model.complete(request())
    with pytest.raises(ModelError, match="no further answer"):
        await model.complete(request())


async def test_a_function() -> None:
    model = ScriptedModel(lambda asked: asked.purpose, name="echo")
    assert (await model.complete(ModelRequest((), "reflect"))).text == "reflect"
    assert model.name == "echo"


def answers(seed: int, count: int = 300) -> list[str]:
    seeded = SeededAnswers(seed)
    return [str(seeded(request(str(i % 20)))) for i in range(count)]


def test_a_seed_decides_everything() -> None:
    assert answers(1) == answers(1)
    assert answers(1) != answers(2)
    assert len(Counter(answers(1)[::20])) > 2, "the same question is always answered alike"


def test_what_was_asked_between_does_not_matter() -> None:
    straight, crossed = SeededAnswers(1), SeededAnswers(1)
    expected = [straight(request("a")) for _ in range(5)]
    found = []
    for i in range(5):
        crossed(request(f"other {i}"))
        found.append(crossed(request("a")))
    assert found == expected


@pytest.mark.parametrize("kind", AnswerKind)
def test_every_kind(kind: AnswerKind) -> None:
    said = SeededAnswers(1, {kind: 1})(request())
    if kind is AnswerKind.EMPTY:
        assert isinstance(said, ModelError) and said.kind is ModelErrorKind.EMPTY
        return
    assert isinstance(said, str)
    lines = [line.removeprefix("Action: ") for line in said.splitlines()]
    proper = len(lines) == 2 and lines[0].startswith("Reasoning: ") and lines[1] in ACTIONS
    assert proper == (kind in (AnswerKind.PLAN, AnswerKind.RANDOM))


def test_a_plan() -> None:
    seeded = SeededAnswers(1, {AnswerKind.PLAN: 1}, plan=lambda _: ACTIONS[1])
    assert str(seeded(request())).endswith(f"\nAction: {ACTIONS[1]}")
    assert str(seeded(ModelRequest((), "reflect"))).startswith("Reflection: ")


@pytest.mark.parametrize(
    ("instructions", "form"),
    [
        ("Answer so:\nReasoning: why\nAction: what", AnswerForm.STEP),
        ("Answer so:\nPlan:\nall of it", AnswerForm.PLAN),
        ("Answer so:\nAction: what\nThen: what changes", AnswerForm.CHAIN),
        ("Answer so:\nReasoning: why\nActions:\na line for each", AnswerForm.JOINT),
        ("Do as you like", AnswerForm.STEP),
    ],
)
def test_it_answers_in_the_form_that_is_asked_for(instructions: str, form: AnswerForm) -> None:
    observation = "Valid Actions:\n" + "\n".join(ACTIONS) + "\n\nGoal: x"
    asked = ModelRequest((Message("user", instructions), Message("user", observation)))
    assert AnswerForm.asked_for(asked) is form
    said = SeededAnswers(1, {AnswerKind.RANDOM: 1})(asked)
    assert isinstance(said, str)
    heads = {
        AnswerForm.STEP: "Reasoning: ",
        AnswerForm.PLAN: "Plan:\n",
        AnswerForm.CHAIN: "Action: ",
        AnswerForm.JOINT: "Reasoning: ",
    }
    assert said.startswith(heads[form])
    assert any(action in said for action in ACTIONS)


@pytest.mark.parametrize("name", OWN_STRATEGIES)
def test_no_strategy_finds_it_malformed(name: str) -> None:
    state = World("asynchronous/01").initial
    valid = tuple(action.sentence for action in state.actions("robot1"))
    observation = Observation(state.text_view("robot1"), valid, "robot1", state)
    asking = own_strategy(own_pack(), name, "asynchronous").propose(observation)
    answers = SeededAnswers(2, {AnswerKind.RANDOM: 1})
    said = answers(next(asking))
    assert isinstance(said, str)
    with pytest.raises(StopIteration) as stop:
        asking.send(Completion(said))
    proposal = stop.value.value
    assert proposal.actions and set(proposal.actions) <= set(valid)
    assert not any(exchange.verdict.rejected for exchange in proposal.exchanges)


def joint_answer(kind: AnswerKind, seed: int) -> tuple[list[Exchange], dict[str, Proposal]]:
    """What a team of three is told to do, and what the model was asked for it."""
    state = World(load_task("multi_agent/01", seats=3)).initial
    seen = {
        player: Observation(
            state.text_view(player), tuple(a.sentence for a in state.actions(player)), player, state
        )
        for player in ("robot1", "robot3")
    }
    strategy = team_strategy(own_pack(), "react-last-reasoning-action", "multi_agent", "joint")
    model = ScriptedModel(SeededAnswers(seed, {kind: 1}))
    taken: dict[str, Proposal] = {}
    asyncio.run(Joint(strategy, model.complete).propose(seen, taken.__setitem__))
    return list(taken["robot1"].exchanges), taken


@pytest.mark.parametrize("kind", [k for k in AnswerKind if k is not AnswerKind.EMPTY])
def test_a_joint_answer_has_a_line_for_each_robot_that_is_asked_for(kind: AnswerKind) -> None:
    exchanges, taken = joint_answer(kind, 3)
    assert set(taken) == {"robot1", "robot3"}
    usable = {AnswerKind.PLAN, AnswerKind.RANDOM, AnswerKind.WRONG_CASE, AnswerKind.FULL_STOP}
    if kind not in usable | {AnswerKind.SEVERAL}:
        assert all(exchange.verdict.rejected for exchange in exchanges)
        return
    assert [exchange.verdict.rejected for exchange in exchanges] == [False]
    assert all(player in taken[player].actions[0] for player in taken)
    assert "Reasoning" not in exchanges[0].action
    if kind in usable:
        assert len(exchanges[0].action.splitlines()) == 2
