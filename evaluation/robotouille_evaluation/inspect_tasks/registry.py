"""Tasks and mock model that Inspect finds through the entry point `robotouille`."""

from __future__ import annotations

from typing import Any

from inspect_ai import Task, task
from inspect_ai.model import (
    ChatMessage,
    GenerateConfig,
    ModelAPI,
    ModelOutput,
    ModelUsage,
    modelapi,
)
from inspect_ai.tool import ToolChoice, ToolInfo

from robotouille.installation import VERSION
from robotouille.terminal import options_from
from robotouille_evaluation.inspect_tasks.play import play
from robotouille_evaluation.inspect_tasks.samples import (
    METRICS,
    STEPS_TO_GO_METRICS,
    TaskOptions,
    TeamTaskOptions,
    load_pack,
    of_distribution,
    outcome,
    samples,
)
from robotouille_evaluation.models import Message, ModelRequest, ScriptedModel, SeededAnswers

__all__ = ["MockModel", "asynchronous", "multi_agent", "outcome", "play", "synchronous"]


@task
@of_distribution
@options_from(TaskOptions)
def synchronous(options: TaskOptions) -> Task:
    """Return the tasks in which nothing takes time."""
    return _task("synchronous", options)


@task
@of_distribution
@options_from(TaskOptions)
def asynchronous(options: TaskOptions) -> Task:
    """Return the tasks in which cooking goes on while a robot does something else."""
    return _task("asynchronous", options)


@task
@of_distribution
@options_from(TeamTaskOptions)
def multi_agent(options: TeamTaskOptions) -> Task:
    """Return the tasks for several robots, each with an agent of its own, in lockstep."""
    return _task("multi_agent", options)


def _task(dataset: str, options: TaskOptions) -> Task:
    pack = load_pack(options.pack)
    return Task(
        dataset=samples(pack, dataset, options),
        solver=play(
            options.strategy, options.pack, options.pictures, options.steps_to_go, options.out
        ),
        scorer=outcome(),
        metrics=METRICS | STEPS_TO_GO_METRICS if options.steps_to_go else None,
        # A model error ends its own episode, and the other episodes go on.
        fail_on_error=False,
        version=pack.version,
        metadata={
            "pack": {"name": pack.name, "version": pack.version, "digest": pack.digest},
            "strategy": options.strategy,
            "software": f"robotouille {VERSION}",
        },
    )


@modelapi(name="robotouille")
class MockModel(ModelAPI):
    """Inspect model with seeded answers, most of them valid actions.

    Args:
        model_name: Any name; it makes no difference.
        seed: Seed of all answers (`-M seed=1`).
    """

    def __init__(
        self,
        model_name: str,
        base_url: str | None = None,
        api_key: str | None = None,
        config: GenerateConfig | None = None,
        seed: int = 0,
        **model_args: Any,
    ) -> None:
        super().__init__(model_name, base_url, api_key, [], config or GenerateConfig())
        self._model = ScriptedModel(SeededAnswers(seed))

    async def generate(
        self,
        input: list[ChatMessage],
        tools: list[ToolInfo],
        tool_choice: ToolChoice,
        config: GenerateConfig,
    ) -> ModelOutput:
        """Return the answer to a conversation."""
        request = ModelRequest(tuple(Message(each.role, each.text) for each in input))
        answer = await self._model.complete(request)
        output = ModelOutput.from_content(self.model_name, answer.text)
        sent, received = answer.usage.prompt_tokens, answer.usage.completion_tokens
        output.usage = ModelUsage(
            input_tokens=sent, output_tokens=received, total_tokens=sent + received
        )
        return output
