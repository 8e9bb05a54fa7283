"""I/O and I/O chain of thought: the whole plan in one answer (paper, baselines)."""

from __future__ import annotations

from robotouille.planning.policies import Did
from robotouille_evaluation.agents.answers import AnswerParser, Published
from robotouille_evaluation.agents.proposal import (
    Exchange,
    ExchangeVerdict,
    Observation,
    Proposal,
    ProposalSteps,
)
from robotouille_evaluation.agents.react import Prompts
from robotouille_evaluation.models.model import Message, ModelRequest

__all__ = ["PlanOnce"]


class PlanOnce:
    """Asks once for a plan, which is carried out only if all of it can be."""

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
        self._parser = parser or Published()

    def observe(self, did: Did) -> None:
        """It reads what came of it in the next observation."""

    def retry(self) -> bool:
        """Never."""
        return False

    def propose(self, observation: Observation) -> ProposalSteps:
        """The plan, after which the agent is done."""
        messages = [*self._prompts.messages(), Message("user", observation.text)]
        request = ModelRequest(tuple(messages))
        completion = yield request
        parser = self._parser
        read = parser.steps if self._chain_of_thought else parser.plan
        actions = read(completion.text)
        verdict = ExchangeVerdict.PLAN if actions else ExchangeVerdict.NO_ACTION
        exchange = Exchange(request, completion, verdict)
        return Proposal(actions, done=True, whole=True, exchanges=(exchange,))
