"""An episode of a team in lockstep: the seats that are free are asked, then a step is taken."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from robotouille import State, World
from robotouille_evaluation.agents.proposal import Exchange, Proposal
from robotouille_evaluation.agents.teams.team import Team
from robotouille_evaluation.runs.stage import Decision, Stage
from robotouille_evaluation.runs.text_episode import Ended, View, observe

__all__ = ["TeamResult", "play_team"]


@dataclass(frozen=True, slots=True)
class TeamResult:
    """How an episode went, and what each player's model was asked."""

    ended: Ended
    success: bool
    steps: int
    exchanges: Mapping[str, tuple[Exchange, ...]]


async def play_team(
    world: World,
    team: Team,
    budget: float,
    stage: Stage,
    view: View | None = State.text_view,
) -> TeamResult:
    """Play until the goal, until the steps are used up, or until nobody wants to go on.

    One whose answers are no action, or who has finished, does nothing. A proposed plan of several
    actions is carried out as far as each is valid.
    """
    state, steps = stage.state, 0
    waiting: dict[str, list[str]] = {player: [] for player in world.players}
    told: dict[str, Proposal] = dict.fromkeys(world.players, Proposal())
    done: set[str] = set()
    exchanges: dict[str, list[Exchange]] = {player: [] for player in world.players}

    def take(player: str, proposal: Proposal) -> None:
        waiting[player] = list(proposal.actions)
        told[player] = proposal
        exchanges[player] += proposal.exchanges
        for exchange in proposal.exchanges:
            stage.answered(player, exchange)
        if proposal.say:
            stage.say(player, proposal.say)
        if proposal.done:
            done.add(player)

    while steps < math.ceil(budget):
        asked = [p for p in _free(world, state) if p not in done and not waiting[p]]
        if asked:
            await team.propose({p: observe(state, p, view) for p in asked}, take)
        if len(done) == len(world.players) and not any(waiting.values()):
            return _result(Ended.FINISH, steps, exchanges)
        decisions = {p: _next(stage, state, p, waiting[p], told[p]) for p in _free(world, state)}
        moved = stage.step(decisions)
        state, steps = moved.state, steps + 1
        team.observe(moved.did)
        for player, reasons in moved.refused.items():
            team.refused(player, decisions[player].action, reasons)
        if state.goal_reached:
            return _result(Ended.GOAL, steps, exchanges)
    return _result(Ended.STEP_LIMIT, steps, exchanges)


def _free(world: World, state: State) -> list[str]:
    return [player for player in world.players if not state.busy_steps(player)]


def _next(stage: Stage, state: State, player: str, waiting: list[str], told: Proposal) -> Decision:
    if not waiting:
        return Decision()
    decision = Decision(waiting.pop(0), told.reasoning, anticipates=told.anticipates)
    valid = {action.sentence for action in state.actions(player)}
    if decision.anticipates or not decision.action or decision.action in valid:
        return decision
    stage.refuse(player, decision, state)
    waiting.clear()
    return Decision()


def _result(ended: Ended, steps: int, exchanges: Mapping[str, list[Exchange]]) -> TeamResult:
    said = {player: tuple(all_of) for player, all_of in exchanges.items()}
    return TeamResult(ended, ended is Ended.GOAL, steps, said)
