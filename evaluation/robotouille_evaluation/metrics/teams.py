"""How players work together: who contributes, who is in whose way, how much at the same time."""

from __future__ import annotations

from robotouille.domain.schema import DomainFile
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille_evaluation.metrics.action_kinds import is_travel, is_waiting
from robotouille_evaluation.metrics.trajectory import Trajectory

__all__ = ["blocking", "contributions", "overlap"]


def contributions(trajectory: Trajectory) -> dict[str, float]:
    """Each player's share of the applied actions that change a thing: neither waiting nor walking.

    Shares sum to 1; where nobody did anything, all are 0. (Overcooked-AI studies report "agent
    contribution" in this way, over dishes and ingredients.)
    """
    counts = dict.fromkeys(trajectory.world.players, 0)
    for joint in trajectory.moves:
        for move in joint:
            if move.applied and not (is_waiting(move.action) or is_travel(move.action)):
                counts[move.player] += 1
    total = sum(counts.values())
    return {player: count / total if total else 0.0 for player, count in counts.items()}


def blocking(trajectory: Trajectory) -> int:
    """Actions that were refused because of another player.

    Either a station was wanted at which another stands, or the action applied in the state of
    that step and did no more when its turn came, for what another had done in the same step.
    """
    occupied = _occupied_predicates(trajectory.world.task.domain)
    count = 0
    for before, joint, _ in trajectory.each_step():
        for move in joint:
            if not move.applied:
                outrun = trajectory.world.applicable(before, move.action)
                count += outrun or _in_the_way(move.unmet, occupied)
    moved = {
        (step, move.player)
        for step, joint in enumerate(trajectory.moves)
        for move in joint
        if not move.applied
    }
    for answer in trajectory.answers:
        if answer.wrong and (answer.step, answer.seat) not in moved:
            count += _in_the_way(answer.unmet, occupied)
    return count


def _in_the_way(unmet: tuple[Unmet, ...], occupied: frozenset[str]) -> bool:
    """Whether that a station is taken is all that speaks against an action."""
    return bool(unmet) and all(
        each.kind is UnmetKind.CONDITION and each.predicate in occupied for each in unmet
    )


def _occupied_predicates(domain: DomainFile) -> frozenset[str]:
    """The predicates that say that nobody stands at a station, as `vacant` does."""
    rules = domain.layout or ()
    facing = {rule.predicate for rule in rules if rule.when == "faces"}
    return frozenset(rule.predicate for rule in rules if facing.intersection(rule.unless or ()))


def overlap(trajectory: Trajectory) -> float | None:
    """The share of steps in which two players or more act or are busy; waiting is no action.

    None for one player, and without steps. (It is the parallel share of a schedule.)
    """
    players = trajectory.world.players
    if len(players) < 2 or not trajectory.steps:
        return None
    count = 0
    for before, joint, _ in trajectory.each_step():
        active = {move.player for move in joint if move.applied and not is_waiting(move.action)}
        active |= {player for player in players if before.busy_steps(player)}
        count += len(active) > 1
    return count / trajectory.steps
