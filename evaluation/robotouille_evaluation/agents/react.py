"""ReAct: one reasoned action at a time (Yao et al., ICLR 2023), in the paper's variants."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field

from robotouille.planning.policies import Did
from robotouille_evaluation.agents.answers import AnswerParser, Published
from robotouille_evaluation.agents.histories import History, as_messages, remembered
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    ContextOverflow,
    Exchange,
    ExchangeVerdict,
    Observation,
    Proposal,
    ProposalSteps,
)
from robotouille_evaluation.agents.teams.chat import heard_text, spoken
from robotouille_evaluation.models.model import Completion, Message, ModelRequest

__all__ = ["Prompts", "ReAct", "ReActSettings"]

Asking = Generator[ModelRequest, Completion, tuple[ModelRequest, Completion]]

NO_REASONING = (
    "The reasoning was malformed. Please provide a valid reasoning in the form "
    "'Reasoning: <reasoning>'."
)
FINISH = "Finish"


@dataclass(frozen=True, slots=True)
class Prompts:
    """What is said first: who the model is, what to do, and examples as turns of the chat."""

    system: str
    instructions: str
    examples: tuple[tuple[str, str], ...] = ()

    def messages(self) -> list[Message]:
        """The beginning of every request."""
        return [
            Message("system", self.system),
            Message("user", self.instructions),
            *as_messages(list(self.examples)),
        ]


@dataclass(frozen=True, slots=True)
class ReActSettings:
    """A variant of ReAct."""

    history: History = History.FULL
    rules: str = ""
    """Said again below each observation."""
    max_refused: int = 5
    """Answers in a row without a valid action, after which there is none."""
    max_failures: int = 3
    """So often, in all, after which the agent gives up."""
    parser: AnswerParser = field(default_factory=Published)
    truncate: bool = False
    """Where a request is too long the oldest turns are left out until it fits; otherwise it is
    tried once without the history, which must be a single turn, as the published code does."""
    talks: bool = False
    """Whether it is shown what others say, and may answer `Say: …`: its prompt speaks of both."""


class ReAct:
    """Asks for one action, with feedback on answers that are none."""

    retries_left = 0

    def __init__(self, prompts: Prompts, settings: ReActSettings | None = None) -> None:
        self._prompts = prompts
        self._settings = settings or ReActSettings()
        self._history: list[tuple[str, str]] = []
        self._feedback = ""
        self._failures = 0
        self.footer = ""
        """Below each observation, behind the rules."""

    def observe(self, did: Did) -> None:
        """It reads what came of it in the next observation."""

    def retry(self) -> bool:
        """Never."""
        return False

    def propose(self, observation: Observation) -> ProposalSteps:
        """An action, or none after `max_refused` answers without a valid one."""
        exchanges: list[Exchange] = []
        for _ in range(self._settings.max_refused):
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
        """What an answer says to everybody."""
        answer = exchange.completion if self._settings.talks else None
        return spoken(answer.text) if answer is not None else ""

    def _ask(
        self, observation: Observation, exchanges: list[Exchange]
    ) -> Generator[ModelRequest, Completion, Exchange]:
        heard = heard_text(observation.heard) if self._settings.talks else ""
        shown = filter(None, [heard, observation.text, self._settings.rules])
        text = "\n\n".join(shown) + self.footer
        prompt = f"Error Feedback: {self._feedback}\n{text}" if self._feedback else text
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
        """What is sent again of an answer: of a megabyte, if requests are shortened at all, as
        much as is recorded."""
        return said[:MAX_REASONING] if said is not None and self._settings.truncate else said

    def _complete(self, prompt: str, exchanges: list[Exchange]) -> Asking:
        """The answer; with less history where the request is too long."""
        while True:
            request = self._request(prompt)
            try:
                return request, (yield request)
            except ContextOverflow:
                exchanges.append(Exchange(request, None, ExchangeVerdict.OVERFLOW))
                if not self._history or not (self._settings.truncate or len(self._history) == 1):
                    raise
                self._history = self._history[1:]

    def _request(self, prompt: str) -> ModelRequest:
        turns = [*self._prompts.messages(), *as_messages(self._history), Message("user", prompt)]
        return ModelRequest(tuple(turns))
