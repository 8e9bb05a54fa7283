"""Teams with a model for each seat, all asked at the same time."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.agents.proposal import AgentObservation, Complete, Proposal
from robotouille_evaluation.agents.team import IndependentTeam
from robotouille_evaluation.models import Completion, ModelRequest
from robotouille_evaluation.packs.own import build_own_pack
from tests.support.virtual_time import run

SEEN = {
    player: AgentObservation(f"You are {player}.", ("Do nothing",), player)
    for player in ("robot1", "robot2", "robot3")
}


class Players:
    """Models that answer after a time."""

    def __init__(self, seconds: Mapping[str, float]) -> None:
        self.asked: dict[str, list[str]] = {player: [] for player in SEEN}
        self.took: list[str] = []
        pack = build_own_pack()
        strategies = {p: make_strategy(pack, "react-talk", "multi_agent") for p in SEEN}
        self.team = IndependentTeam(strategies, {p: self._slow(p, seconds[p]) for p in SEEN})

    def _slow(self, player: str, seconds: float) -> Complete:
        async def complete(request: ModelRequest) -> Completion:
            self.asked[player].append(request.messages[-1].content)
            await asyncio.sleep(seconds)
            return Completion(f"Reasoning: so.\nSay: I am {player}\nAction: Do nothing")

        return complete

    def take(self, player: str, proposal: Proposal) -> None:
        assert proposal.exchanges
        self.took.append(player)


def test_messages_are_delivered_in_seat_order() -> None:
    """A resumed run is answered at once and must send the same requests."""
    told = []
    for seconds in ({"robot1": 9, "robot2": 1, "robot3": 5}, dict.fromkeys(SEEN, 0)):
        players = Players(seconds)
        for _ in range(2):
            run(players.team.propose(SEEN, players.take))
        assert players.took == [*SEEN, *SEEN]
        told.append(players.asked)
    assert told[0] == told[1]
    heard = told[0]["robot3"][1]
    assert heard.index("I am robot1") < heard.index("I am robot2")
