"""`--model robotouille/mock` in Inspect: answers by a seed, to try everything without a key."""

from __future__ import annotations

from typing import Any

from inspect_ai.model import (
    ChatMessage,
    GenerateConfig,
    ModelAPI,
    ModelOutput,
    ModelUsage,
    modelapi,
)
from inspect_ai.tool import ToolChoice, ToolInfo

from robotouille_evaluation.models import Message, ModelRequest, ScriptedModel, SeededAnswers

__all__ = ["MockModel"]


@modelapi(name="robotouille")
class MockModel(ModelAPI):
    """Answers mostly with valid actions.

    Args:
        model_name: What it is called; it makes no difference.
        seed: Decides all answers (`-M seed=1`).
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
        """The answer to a conversation."""
        request = ModelRequest(tuple(Message(said.role, said.text) for said in input))
        answer = await self._model.complete(request)
        output = ModelOutput.from_content(self.model_name, answer.text)
        sent, received = answer.usage.prompt_tokens, answer.usage.completion_tokens
        output.usage = ModelUsage(
            input_tokens=sent, output_tokens=received, total_tokens=sent + received
        )
        return output
