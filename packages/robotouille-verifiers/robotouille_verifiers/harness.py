"""Harness that plays a game in this process and asks the model through verifiers' endpoint."""

from __future__ import annotations

import asyncio
from typing import Any

import verifiers.v1 as vf
from openai import AsyncOpenAI, OpenAIError
from pydantic import model_validator

from robotouille.errors import RobotouilleError
from robotouille_evaluation.agents.team import Control
from robotouille_evaluation.models import Message
from robotouille_evaluation.text_games import (
    CONVERSATION,
    GameOptions,
    TextGame,
    load_instance,
)
from robotouille_verifiers.taskset import SCORE

RETRIES = 4
"""Retries of a request that the endpoint could not answer; the client waits longer each time."""


class RobotouilleHarnessConfig(vf.HarnessConfig):
    """Way to ask the model (`--env.agent.harness.NAME`); see `GameOptions`."""

    agent: str = CONVERSATION
    control: Control = "turns"
    partner: str = ""

    @model_validator(mode="after")
    def _is_possible(self) -> RobotouilleHarnessConfig:
        try:
            self.options()
        except RobotouilleError as error:
            raise ValueError(str(error)) from None
        return self

    def options(self) -> GameOptions:
        """Return the options of a game."""
        return GameOptions(self.agent, self.control, self.partner)


class RobotouilleHarness(vf.Harness[RobotouilleHarnessConfig]):
    """Agent of Robotouille's benchmark: its prompts, parser and feedback."""

    APPENDS_SYSTEM_PROMPT = True
    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    async def launch(
        self,
        ctx: vf.ModelContext,
        trace: vf.Trace,
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: Any,
    ) -> vf.ProgramResult:
        """Play a game to its end, and keep its score in the trace."""
        # Generating and planning take up to seconds, in which other games must go on.
        instance = await asyncio.to_thread(load_instance, data.instance, data.seats)
        game = await asyncio.to_thread(TextGame, instance, self.config.options())
        client = AsyncOpenAI(base_url=endpoint, api_key=secret, max_retries=RETRIES)
        try:
            async with client:
                while game.request is not None:
                    messages = _with_system(game.request.messages, data.system_prompt)
                    text = await _answer(client, ctx.model, messages)
                    await asyncio.to_thread(game.answer, text)
        except OpenAIError as error:
            # verifiers knows the real cause, or has refused the request to end the game.
            return vf.ProgramResult(1, "", f"{type(error).__name__}: {error}")
        finally:
            trace.info[SCORE] = game.score.as_json()
        return vf.ProgramResult(0, "", "")


async def _answer(client: AsyncOpenAI, model: str, messages: list[dict[str, str]]) -> str:
    """Return the model's answer; empty if it has no text."""
    sent: Any = messages
    answer = await client.chat.completions.create(model=model, messages=sent)
    return (answer.choices[0].message.content or "") if answer.choices else ""


def _with_system(messages: tuple[Message, ...], system: str | None) -> list[dict[str, str]]:
    """Return messages for the endpoint, with the system prompt of the task, if it has one."""
    sent = [{"role": each.role, "content": each.content} for each in messages]
    if system is not None:
        sent = [{"role": "system", "content": system}, *(m for m in sent if m["role"] != "system")]
    return sent
