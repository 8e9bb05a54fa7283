"""A team: one model for each seat, or one for all seats, which is asked for them in turn.

Any strategy plays alone and in a team. What plays an episode asks the team, and not the strategies:

    team = Turns(strategy, complete)
    await team.propose({"robot1": seen, "robot2": also_seen}, take)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, Protocol

from robotouille.planning.policies import Did
from robotouille_evaluation.agents.asking import Complete, all_of, answer_all
from robotouille_evaluation.agents.proposal import Observation, Proposal, Strategy
from robotouille_evaluation.agents.teams.chat import TeamChat

__all__ = ["Control", "Each", "Refusals", "Take", "Team", "Turns"]

Control = Literal["each", "turns", "joint"]
"""One model a seat; one for all seats, asked for one after the other; or for all at once."""

Take = Callable[[str, Proposal], None]
"""Is told what each seat does, in their order. A call of a model is in one proposal only."""


class Team(Protocol):
    """How the models of several seats are asked."""

    async def propose(self, seen: Mapping[str, Observation], take: Take) -> None:
        """What the seats do now that see this, in the order of the seats.

        Raises:
            ContextOverflow: A model takes no request as long as this.
            ModelError: A model has not answered.
        """
        ...

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        ...

    def refused(self, player: str, action: str, reasons: Sequence[str]) -> None:
        """An action was valid when it was chosen, and was not possible in its step."""
        ...


class Each:
    """A strategy, and so a conversation, for each seat. They hear what the others say."""

    def __init__(
        self, strategies: Mapping[str, Strategy], complete: Mapping[str, Complete]
    ) -> None:
        self._strategies = strategies
        self._complete = complete
        self._chat = TeamChat(strategies)

    async def propose(self, seen: Mapping[str, Observation], take: Take) -> None:
        """All at the same time. Whoever answers first, they are heard in the order of seats: a run
        that goes on after a kill asks what it has asked."""
        heard = {player: self._chat.read(player) for player in seen}
        proposals: dict[str, Proposal] = {}

        async def decide(player: str) -> None:
            shown = replace(seen[player], heard=(*seen[player].heard, *heard[player]))
            asking = self._strategies[player].propose(shown)
            proposals[player] = await answer_all(asking, self._complete[player])

        try:
            await all_of(map(decide, seen))
        finally:
            for player in seen:
                if player in proposals:
                    self._chat.say(player, proposals[player].say)
                    take(player, proposals[player])

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        for strategy in self._strategies.values():
            strategy.observe(did)

    def refused(self, player: str, action: str, reasons: Sequence[str]) -> None:
        """Each reads what came of it in its next observation."""


class Refusals:
    """What was not possible in a step, until the model of the team is asked again."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def add(self, player: str, action: str, reasons: Sequence[str]) -> None:
        """An action was not possible."""
        why = f": {'; '.join(reasons)}" if reasons else ""
        self._lines.append(f"In its last step {player} could not do this: {action}{why}.")

    def before(self, text: str) -> str:
        """An observation with what was refused above it, once."""
        lines, self._lines = self._lines, []
        return "\n\n".join(["\n".join(lines), text]) if lines else text


class Turns:
    """One strategy, and so one conversation, for all seats: in each step it is asked for one after
    the other, and is told what it has chosen for those before."""

    def __init__(self, strategy: Strategy, complete: Complete) -> None:
        self._strategy = strategy
        self._complete = complete
        self._refusals = Refusals()

    async def propose(self, seen: Mapping[str, Observation], take: Take) -> None:
        """One after the other."""
        chosen: list[str] = []
        for player, observation in seen.items():
            text = "\n\n".join(filter(None, [observation.text, "\n".join(chosen)]))
            shown = replace(observation, text=self._refusals.before(text))
            proposal = await answer_all(self._strategy.propose(shown), self._complete)
            take(player, proposal)
            actions = "; then: ".join(filter(None, proposal.actions)) or "nothing"
            chosen.append(f"In this step {player} will do: {actions}.")

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        self._strategy.observe(did)

    def refused(self, player: str, action: str, reasons: Sequence[str]) -> None:
        """Is told in the next request."""
        self._refusals.add(player, action, reasons)
