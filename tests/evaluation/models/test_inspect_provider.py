"""Models of Inspect's providers: requests, answers, and errors without keys."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

from robotouille.errors import MissingExtraError
from robotouille_evaluation.models import (
    Completion,
    InspectModel,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    Usage,
    open_inspect_model,
)

if TYPE_CHECKING:
    from inspect_ai.model import ChatMessage, GenerateConfig, ModelOutput

KEY = "sk-abcdefghijklmnop"
REQUEST = ModelRequest(
    (
        Message("system", "You cook."),
        Message("user", "What now?"),
        Message("assistant", "Wait."),
        Message("user", "What now?"),
    ),
    parameters={"temperature": 0.5},
)


def test_missing_inspect_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "inspect_ai.model", None)
    with pytest.raises(MissingExtraError, match=r"robotouille\[bench\]"):
        open_inspect_model("anthropic/any")


@pytest.fixture(autouse=True)
def with_inspect(request: pytest.FixtureRequest) -> Iterator[None]:
    if request.node.name == test_missing_inspect_names_the_extra.__name__:
        yield
        return
    pytest.importorskip("inspect_ai")
    with warnings.catch_warnings():  # Inspect's retry library warns.
        warnings.filterwarnings("ignore", "The 'initial' parameter", DeprecationWarning)
        yield


def output(text: str, reason: Any = "stop", **used: Any) -> ModelOutput:
    from inspect_ai.model import ModelOutput, ModelUsage

    found = ModelOutput.from_content("mockllm", text, stop_reason=reason)
    found.usage = ModelUsage(**used)
    return found


def answering(answer: Callable[..., Any]) -> InspectModel:
    from inspect_ai.model import get_model

    return InspectModel(get_model("mockllm/model", custom_outputs=answer))


async def refused(answer: Callable[..., Any]) -> ModelError:
    with pytest.raises(ModelError) as caught:
        await answering(answer).complete(REQUEST)
    return caught.value


async def test_conversation_and_settings_are_sent_unchanged() -> None:
    sent: list[list[ChatMessage]] = []
    settings: list[GenerateConfig] = []

    def answer(
        messages: list[ChatMessage], _: object, __: object, config: GenerateConfig
    ) -> ModelOutput:
        sent.append(messages)
        settings.append(config)
        return output("Stir.", input_tokens=4, input_tokens_cache_read=6, output_tokens=2)

    model = answering(answer)
    completion = await model.complete(REQUEST)
    await model.complete(REQUEST)
    assert model.name == "mockllm/model"
    assert (completion.text, completion.usage) == ("Stir.", Usage(10, 2))
    assert [(said.role, said.text) for said in sent[0]] == [
        (message.role, message.content) for message in REQUEST.messages
    ]
    assert settings[0].temperature == 0.5
    ids = [[said.id for said in messages] for messages in sent]
    assert len(set(ids[0])) == len(ids[0])
    assert ids[0] == ids[1]


async def test_cost_comes_from_the_provider() -> None:
    model = answering(lambda *_: output("Stir.", total_cost=0.25))
    assert (await model.complete(REQUEST)).usage.cost == 0.25


async def test_answers_are_cut_at_a_megabyte() -> None:
    completion = await answering(lambda *_: output("x" * 1_100_000)).complete(REQUEST)
    assert len(completion.text) == 1_000_000
    assert completion.finish_reason == "too-long"


@pytest.mark.parametrize(
    ("text", "reason", "kind"),
    [
        ("", "stop", ModelErrorKind.EMPTY),
        ("", "content_filter", ModelErrorKind.EMPTY),
        ("the prompt is too long", "model_length", ModelErrorKind.CONTEXT_OVERFLOW),
    ],
)
async def test_missing_answers_have_a_kind(text: str, reason: str, kind: ModelErrorKind) -> None:
    assert (await refused(lambda *_: output(text, reason))).kind is kind


async def test_an_answer_cut_by_the_context_is_an_answer() -> None:
    model = answering(lambda *_: output("Sti", "model_length", output_tokens=1))
    assert isinstance(await model.complete(REQUEST), Completion)


class StatusError(Exception):
    def __init__(self, status_code: int, message: str) -> None:
        self.status_code, self.message = status_code, message
        super().__init__(message)


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (StatusError(401, f"wrong key {KEY}"), ModelErrorKind.REFUSED),
        (StatusError(400, f"{KEY}: maximum context length"), ModelErrorKind.CONTEXT_OVERFLOW),
        (StatusError(503, f"{KEY} is busy"), ModelErrorKind.SERVER),
        (OSError(f"no line for {KEY}"), ModelErrorKind.ENDPOINT),
        (ValueError(f"[bold]{KEY}[/bold] [/odd"), ModelErrorKind.ENDPOINT),
    ],
)
async def test_provider_errors_have_a_kind_and_no_key(
    error: Exception, kind: ModelErrorKind
) -> None:
    def answer(*_: object) -> ModelOutput:
        raise error

    found = await refused(answer)
    assert found.kind is kind
    assert KEY not in str(found)


async def test_keys_of_the_environment_are_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINE_API_KEY", "correct horse battery")

    def fails(*_: object) -> ModelOutput:
        raise OSError("." * 290 + "correct horse battery")

    found = await refused(fails)
    assert "correct" not in str(found)
    said = output("Action: correct horse battery", input_tokens=1, output_tokens=1)
    completion = await answering(lambda *_: said).complete(REQUEST)
    assert completion.text == "Action: [key]"


async def test_limits_of_inspect_are_passed_on() -> None:
    from inspect_ai.util import LimitExceededError, token_limit

    model = answering(lambda *_: output("Stir.", input_tokens=90, total_tokens=90))
    with pytest.raises(LimitExceededError), token_limit(50):
        await model.complete(REQUEST)


@pytest.mark.parametrize("parameters", [{"temprature": 1}, {"temperature": "hot"}])
def test_invalid_settings_are_refused(parameters: dict[str, object]) -> None:
    with pytest.raises(ModelError, match="temp"):
        open_inspect_model("mockllm/model", parameters=parameters)


@pytest.mark.parametrize("name", ["nobody/any", "any"])
def test_unknown_providers_are_refused(name: str) -> None:
    with pytest.raises(ModelError, match="any"):
        open_inspect_model(name)
