"""Reflexion: a second attempt, with what was learned from the first (Shinn et al., 2023)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

from robotouille.planning.policies import Did
from robotouille_evaluation.agents.histories import as_messages
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    Exchange,
    ExchangeVerdict,
    Observation,
    ProposalSteps,
)
from robotouille_evaluation.agents.react import Prompts, ReAct, ReActSettings
from robotouille_evaluation.models.model import Completion, Message, ModelRequest

__all__ = ["Reflexion"]

REQUEST = "Please follow the instructions and reflect on the previous history.\n\n"
REDUCED = "Observation: ...\n\nValid Actions: ...\n\n"
GOAL = "Goal: "
HEADING = "Reflection: "


class Reflexion:
    """ReAct that reflects on what was said so far before it begins anew."""

    def __init__(
        self,
        prompts: Prompts,
        reflection: Prompts,
        settings: ReActSettings,
        retries: int = 1,
    ) -> None:
        self._inner = ReAct(prompts, settings)
        self._truncate = settings.truncate
        self._reflection = reflection
        self.retries_left = retries
        self._said: list[tuple[str, str]] = []
        self._must_reflect = False

    def observe(self, did: Did) -> None:
        """It reads what came of it in the next observation."""

    def retry(self) -> bool:
        """As often as there are retries left."""
        if self.retries_left == 0:
            return False
        self.retries_left -= 1
        self._must_reflect = True
        return True

    def propose(self, observation: Observation) -> ProposalSteps:
        """An action; in a new trial, after a reflection."""
        reflected = []
        if self._must_reflect:
            self._must_reflect = False
            reflected.append((yield from self._reflect()))
        proposal = yield from self._inner.propose(observation)
        for exchange in proposal.exchanges:
            if exchange.completion is not None:
                prompt = exchange.request.messages[-1].content
                self._said.append((prompt, self._kept(exchange.completion.text)))
        return replace(proposal, exchanges=(*reflected, *proposal.exchanges))

    def _reflect(self) -> Generator[ModelRequest, Completion, Exchange]:
        turns = [(_reduced(prompt), answer) for prompt, answer in self._said[:-1]]
        messages = [
            *self._reflection.messages(),
            *as_messages([*turns, *self._said[-1:]]),
            Message("user", REQUEST),
        ]
        request = ModelRequest(tuple(messages), purpose="reflect")
        completion = yield request
        parts = completion.text.split(HEADING)
        learned = self._kept(parts[1] if len(parts) > 1 else completion.text)
        self._inner.footer = f"\n\n{HEADING}{learned}"
        return Exchange(request, completion, ExchangeVerdict.REFLECTION, reasoning=learned)

    def _kept(self, said: str) -> str:
        """What is sent again of an answer, as of ReAct's own."""
        return said[:MAX_REASONING] if self._truncate else said


def _reduced(prompt: str) -> str:
    """A request without its observation: its goal, and what else stands behind it."""
    parts = prompt.split(GOAL)
    return REDUCED + GOAL + (parts[1] if len(parts) > 1 else "")
