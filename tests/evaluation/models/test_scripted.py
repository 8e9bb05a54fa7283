"""The scripted model, usage, errors, and the examples of the documentation."""

from __future__ import annotations

import copy
import pickle
from collections import Counter
from typing import Any

import pytest

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille_evaluation.agents import AgentObservation
from robotouille_evaluation.agents.making import OWN_STRATEGIES, own_strategy
from robotouille_evaluation.models import (
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
from robotouille_evaluation.models.model import NOTHING
from robotouille_evaluation.packs.own import build_own_pack as own_pack
from tests.support.openai_server import answer, endpoint, error
from tests.support.pages import blocks, read

ACTIONS = ("Move robot1 from table1 to stove1", "Pick up patty1 from table1 using robot1")


def request(words: str = "") -> ModelRequest:
    observation = f"{words}\nValid Actions:\n" + "\n".join(ACTIONS) + "\n\nGoal: a burger"
    return ModelRequest((Message("user", observation),))


async def test_answers_of_a_list() -> None:
    full = ModelError(ModelErrorKind.CONTEXT_OVERFLOW, "scripted")
    model = ScriptedModel.of(["two words", Completion("x", attempts=3), full])
    answer = await model.complete(request())
    assert answer.text == "two words" and answer.usage == Usage(18, 2)
    assert (await model.complete(request())).attempts == 3
    with pytest.raises(ModelError, match="context-overflow"):
        await model.complete(request())
    with pytest.raises(ModelError, match="no further answer"):
        await model.complete(request())


async def test_answers_of_a_function() -> None:
    model = ScriptedModel(lambda asked: asked.purpose, name="echo")
    assert (await model.complete(ModelRequest((), "reflect"))).text == "reflect"
    assert model.name == "echo"


def answers(seed: int, count: int = 300) -> list[str]:
    seeded = SeededAnswers(seed)
    return [str(seeded(request(str(i % 20)))) for i in range(count)]


def test_answers_depend_only_on_the_seed() -> None:
    assert answers(1) == answers(1)
    assert answers(1) != answers(2)
    assert len(Counter(answers(1)[::20])) > 2, "a repeated question gets different answers"


@pytest.mark.parametrize("kind", AnswerKind)
def test_kinds_of_answers(kind: AnswerKind) -> None:
    said = SeededAnswers(1, {kind: 1})(request())
    if kind is AnswerKind.EMPTY:
        assert isinstance(said, ModelError) and said.kind is ModelErrorKind.EMPTY
        return
    assert isinstance(said, str)
    lines = [line.removeprefix("Action: ") for line in said.splitlines()]
    proper = len(lines) == 2 and lines[0].startswith("Reasoning: ") and lines[1] in ACTIONS
    assert proper == (kind in (AnswerKind.PLAN, AnswerKind.RANDOM))


def test_planned_answers() -> None:
    seeded = SeededAnswers(1, {AnswerKind.PLAN: 1}, plan=lambda _: ACTIONS[1])
    assert str(seeded(request())).endswith(f"\nAction: {ACTIONS[1]}")
    assert str(seeded(ModelRequest((), "reflect"))).startswith("Reflection: ")


@pytest.mark.parametrize("name", OWN_STRATEGIES)
def test_every_strategy_can_read_the_answers(name: str) -> None:
    state = World("asynchronous/01").initial
    valid = tuple(action.sentence for action in state.actions("robot1"))
    observation = AgentObservation(state.text_view("robot1"), valid, "robot1", state)
    asking = own_strategy(own_pack(), name, "asynchronous").propose(observation)
    answers = SeededAnswers(2, {AnswerKind.RANDOM: 1})
    said = answers(next(asking))
    assert isinstance(said, str)
    with pytest.raises(StopIteration) as stop:
        asking.send(Completion(said))
    proposal = stop.value.value
    assert proposal.actions and set(proposal.actions) <= set(valid)
    assert not any(exchange.verdict.rejected for exchange in proposal.exchanges)


def test_usage_adds_up() -> None:
    assert Usage(1, 2) + Usage(3, 4) == Usage(4, 6, None)
    assert Usage(1, 2, 0.5) + Usage(3, 4) == Usage(4, 6), "one cost is unknown"
    assert Usage(1, 2, 0.5) + NOTHING == Usage(1, 2, 0.5)
    assert Usage(cost=0.5) + Usage(cost=0.25) == Usage(cost=0.75)


def test_errors_survive_pickling() -> None:
    error = ModelError(ModelErrorKind.SERVER, "status 500: no", retry_may_help=True)
    error.in_total(3, Usage(1, 2, 0.5))
    assert isinstance(error, RobotouilleError)
    assert str(error) == "server: status 500: no (3 attempts)"
    for twin in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert str(twin) == str(error) and vars(twin) == vars(error)


PAGE = "evaluate_models.md"


@pytest.fixture
def names() -> dict[str, Any]:
    names: dict[str, Any] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE, "exec"), names)
    return names


async def test_the_endpoint_example(names: dict[str, Any]) -> None:
    pytest.importorskip("openai")
    async with endpoint(answer("A fryer."), error(400)) as server:
        assert await names["ask"](server.url, "k") == "A fryer. (0.000064, 1 attempts)"
        assert await names["ask"](server.url, "k") == "refused, after 1 attempts"
    assert server.received[0].body["temperature"] == 0.7


async def test_the_scripted_example(names: dict[str, Any]) -> None:
    assert (await names["model"].complete(ModelRequest(()))).text.startswith("Reflection")


@pytest.mark.parametrize("kind", ModelErrorKind)
def test_every_error_kind_is_documented(kind: ModelErrorKind) -> None:
    assert f"| `{kind}` |" in read(PAGE)
