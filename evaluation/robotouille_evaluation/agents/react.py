"""Strategies: ReAct (Yao et al., ICLR 2023) in the paper's variants, whole plans, Reflexion."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace

from robotouille.planning.policies import Did
from robotouille_evaluation.agents.answers import (
    AnswerParser,
    PromptHistory,
    PublishedParser,
    as_messages,
    remembered,
)
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    AgentObservation,
    ContextOverflow,
    Exchange,
    ExchangeVerdict,
    Proposal,
    ProposalSteps,
)
from robotouille_evaluation.agents.team import heard_text, spoken
from robotouille_evaluation.models.model import Completion, Message, ModelRequest

Asking = Generator[ModelRequest, Completion, tuple[ModelRequest, Completion]]

NO_REASONING = (
    "The reasoning was malformed. Please provide a valid reasoning in the form "
    "'Reasoning: <reasoning>'."
)
FINISH = "Finish"
FEEDBACK = "Error Feedback: "
"""Beginning of the line above an observation that says why an answer was rejected."""


@dataclass(frozen=True, slots=True)
class Prompts:
    """First messages of every request: system prompt, instructions, and examples."""

    system: str
    instructions: str
    examples: tuple[tuple[str, str], ...] = ()

    def messages(self) -> list[Message]:
        """Return the first messages of a request."""
        return [
            Message("system", self.system),
            Message("user", self.instructions),
            *as_messages(list(self.examples)),
        ]


@dataclass(frozen=True, slots=True)
class ReActSettings:
    """Settings of a ReAct variant."""

    history: PromptHistory = PromptHistory.FULL
    rules: str = ""
    """Text that is repeated below each observation."""
    max_rejected: int = 5
    """Rejected answers in a row after which the player does nothing."""
    max_failures: int = 3
    """Total number of such failures after which the agent gives up."""
    parser: AnswerParser = field(default_factory=PublishedParser)
    truncate: bool = False
    """Drop the oldest turns of a request that is too long until it fits. Otherwise repeat it once
    without its history, which must be a single turn, as in the published code."""
    talks: bool = False
    """Show the chat to the model and let it answer `Say: …`. Its prompt must mention both."""


class ReAct:
    """Strategy that asks for one action, with feedback on rejected answers."""

    retries_left = 0

    def __init__(self, prompts: Prompts, settings: ReActSettings | None = None) -> None:
        self._prompts = prompts
        self._settings = settings or ReActSettings()
        self._history: list[tuple[str, str]] = []
        self._feedback = ""
        self._failures = 0
        self.footer = ""
        """Text below each observation, after the rules."""

    def observe(self, did: Did) -> None:
        """Ignore the step: the next observation shows its result."""

    def retry(self) -> bool:
        """Return False: there is one trial."""
        return False

    def propose(self, observation: AgentObservation) -> ProposalSteps:
        """Propose an action, or none after `max_rejected` rejected answers."""
        exchanges: list[Exchange] = []
        for _ in range(self._settings.max_rejected):
            exchange = yield from self._ask(observation, exchanges)
            exchanges.append(exchange)
            if exchange.verdict is ExchangeVerdict.FINISH:
                return Proposal((), exchange.reasoning, done=True, exchanges=tuple(exchanges))
            if exchange.verdict is ExchangeVerdict.ACTION:
                say = self._spoken(exchange)
                return Proposal(
                    (exchange.action,), exchange.reasoning, say=say, exchanges=tuple(exchanges)
                )
        self._failures += 1
        given_up = self._failures >= self._settings.max_failures
        return Proposal(done=given_up, exchanges=tuple(exchanges))

    def _spoken(self, exchange: Exchange) -> str:
        answer = exchange.completion if self._settings.talks else None
        return spoken(answer.text) if answer is not None else ""

    def _ask(
        self, observation: AgentObservation, exchanges: list[Exchange]
    ) -> Generator[ModelRequest, Completion, Exchange]:
        heard = heard_text(observation.heard) if self._settings.talks else ""
        shown = filter(None, [heard, observation.text, self._settings.rules])
        text = "\n\n".join(shown) + self.footer
        prompt = f"{FEEDBACK}{self._feedback}\n{text}" if self._feedback else text
        request, completion = yield from self._complete(prompt, exchanges)
        return self._judge(request, completion, prompt, text, observation.valid)

    def _judge(
        self,
        request: ModelRequest,
        completion: Completion,
        prompt: str,
        text: str,
        valid: Sequence[str],
    ) -> Exchange:
        parser = self._settings.parser
        answer = parser.step(completion.text)
        reasoning, said = self._kept(answer.reasoning), self._kept(answer.action)
        if reasoning is None or said is None:
            # As in the published code, a malformed answer stays in the history in all variants.
            self._history.append((prompt, self._kept(completion.text) or ""))
            verdict = (
                ExchangeVerdict.NO_REASONING if reasoning is None else ExchangeVerdict.NO_ACTION
            )
            self._feedback = NO_REASONING if reasoning is None else parser.no_action
            return Exchange(request, completion, verdict, reasoning or "", said or "",
                            self._feedback)  # fmt: skip
        meant = parser.match(said, tuple(valid))
        action = said if meant is None else meant
        self._history = remembered(
            self._settings.history,
            self._history,
            prompt,
            self._kept(completion.text) or "",
            text,
            reasoning,
            action,
        )
        self._feedback = ""
        if action == FINISH:
            verdict = ExchangeVerdict.FINISH
        elif meant is not None:
            verdict = ExchangeVerdict.ACTION
        else:
            verdict = ExchangeVerdict.INVALID
            self._feedback = parser.invalid(action, tuple(valid))
        return Exchange(request, completion, verdict, reasoning, action, self._feedback)

    def _kept(self, said: str | None) -> str | None:
        """Return the part of an answer that later requests repeat.

        An answer may be a megabyte long. Strategies that shorten requests repeat only what a
        recording would keep.
        """
        return said[:MAX_REASONING] if said is not None and self._settings.truncate else said

    def _complete(self, prompt: str, exchanges: list[Exchange]) -> Asking:
        """Yield requests with less and less history until one is not too long."""
        while True:
            request = self._request(prompt)
            try:
                return request, (yield request)
            except ContextOverflow:
                exchanges.append(Exchange(request, None, ExchangeVerdict.OVERFLOW))
                # The published code retries once without its single turn, and otherwise fails.
                if not self._history or not (self._settings.truncate or len(self._history) == 1):
                    raise
                self._history = self._history[1:]

    def _request(self, prompt: str) -> ModelRequest:
        turns = [*self._prompts.messages(), *as_messages(self._history), Message("user", prompt)]
        return ModelRequest(tuple(turns))


class PlanOnce:
    """Strategy that asks once for a plan, which is carried out only if all of it is valid."""

    retries_left = 0

    def __init__(
        self,
        prompts: Prompts,
        *,
        chain_of_thought: bool = False,
        parser: AnswerParser | None = None,
    ) -> None:
        self._prompts = prompts
        self._chain_of_thought = chain_of_thought
        self._parser = parser or PublishedParser()

    def observe(self, did: Did) -> None:
        """Ignore the step: the next observation shows its result."""

    def retry(self) -> bool:
        """Return False: there is one trial."""
        return False

    def propose(self, observation: AgentObservation) -> ProposalSteps:
        """Propose a complete plan. The agent is not asked again."""
        messages = [*self._prompts.messages(), Message("user", observation.text)]
        request = ModelRequest(tuple(messages))
        completion = yield request
        parser = self._parser
        read = parser.steps if self._chain_of_thought else parser.plan
        actions = read(completion.text)
        verdict = ExchangeVerdict.PLAN if actions else ExchangeVerdict.NO_ACTION
        exchange = Exchange(request, completion, verdict)
        return Proposal(actions, done=True, whole=True, exchanges=(exchange,))


REQUEST = "Please follow the instructions and reflect on the previous history.\n\n"
REDUCED = "Observation: ...\n\nValid Actions: ...\n\n"
GOAL = "Goal: "
HEADING = "Reflection: "


class Reflexion:
    """ReAct that reflects on its conversation and starts again (Shinn et al., NeurIPS 2023)."""

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
        """Ignore the step: the next observation shows its result."""

    def retry(self) -> bool:
        """Use up a retry if one is left."""
        if self.retries_left == 0:
            return False
        self.retries_left -= 1
        self._must_reflect = True
        return True

    def propose(self, observation: AgentObservation) -> ProposalSteps:
        """Propose an action; in a new trial, reflect first."""
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
        # As in the published code, only the last turn keeps its observation.
        turns = [(_reduced(prompt), answer) for prompt, answer in self._said[:-1]]
        messages = [
            *self._reflection.messages(),
            *as_messages([*turns, *self._said[-1:]]),
            Message("user", REQUEST),
        ]
        request = ModelRequest(tuple(messages), purpose="reflect")
        completion = yield request
        # As in the published code, this is the text between the first and a second heading.
        parts = completion.text.split(HEADING)
        learned = self._kept(parts[1] if len(parts) > 1 else completion.text)
        self._inner.footer = f"\n\n{HEADING}{learned}"
        return Exchange(request, completion, ExchangeVerdict.REFLECTION, reasoning=learned)

    def _kept(self, said: str) -> str:
        return said[:MAX_REASONING] if self._truncate else said


def _reduced(prompt: str) -> str:
    """Return a request with its observation replaced by dots; the goal and what follows stay."""
    parts = prompt.split(GOAL)
    return REDUCED + GOAL + (parts[1] if len(parts) > 1 else "")
