"""All metrics of one trajectory, and those of real time and teams."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

from robotouille import World
from robotouille.domain.schema import DomainFile
from robotouille.errors import UnknownNameError
from robotouille.planning import Limits, StepsToGo
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille_evaluation.metrics.asynchrony import (
    asynchronous_first,
    is_travel,
    is_waiting,
    time_shares,
)
from robotouille_evaluation.metrics.failures import Failure, classify
from robotouille_evaluation.metrics.outcomes import recovery, steps_to_go_at_the_end, success_within
from robotouille_evaluation.metrics.rows import EpisodeMeasures, FailureRow
from robotouille_evaluation.metrics.trajectory import AnswerVerdict, StepAnswer, Trajectory


def staleness(trajectory: Trajectory, seat: str = "") -> float | None:
    """Return the mean number of steps between an answer's basis and its application.

    It is 0 in a world that waits.

    Args:
        seat: Seat of the answers; all seats if empty.

    Returns:
        None if no applied answer has a recorded basis.
    """
    steps = [
        answer.step - answer.basis
        for answer in trajectory.answers
        if answer.basis is not None and not answer.wrong and seat in ("", answer.seat)
    ]
    return fmean(steps) if steps else None


@dataclass(frozen=True, slots=True)
class LateAnswers:
    """Number of late answers (`count`), and of those that were applied nevertheless (`held`).

    An answer is late if a step or more has passed since its basis, where its action was valid.
    """

    count: int
    held: int

    @property
    def share(self) -> float | None:
        """Share that held; None without late answers."""
        return self.held / self.count if self.count else None


def late_answers(trajectory: Trajectory) -> LateAnswers:
    """Count the answers that came late, and how many of them still held.

    Actions that were invalid when the model was asked are wrong, not late. Dropped answers did not
    hold, even if they would have applied.
    """
    dropped = [
        StepAnswer(
            each.arrived or 0, each.seat, each.dropped, AnswerVerdict.INVALID, basis=each.basis
        )
        for each in trajectory.thoughts
        if each.dropped
    ]
    held = [
        not answer.wrong
        for answer in (*trajectory.answers, *dropped)
        if answer.basis is not None
        and answer.basis < answer.step
        and _was_valid(trajectory, answer.basis, answer)
    ]
    return LateAnswers(len(held), sum(held))


def _was_valid(trajectory: Trajectory, basis: int, answer: StepAnswer) -> bool:
    state = trajectory.states[basis]
    try:
        action = answer.action or state.world.parse(state, answer.seat, answer.text, valid=False)
    except UnknownNameError:
        return False
    return state.world.applicable(state, action)


def lost_to_thinking(trajectory: Trajectory) -> int | None:
    """Return the number of player steps that were lost while models thought.

    A step is lost if no action of the player was applied and the player was not busy. A helper's
    actions are not lost.

    Returns:
        None if the recording has no thoughts, for example because the world waited.
    """
    if not trajectory.thoughts:
        return None
    lost = set()
    for thought in trajectory.thoughts:
        end = trajectory.steps if thought.arrived is None else thought.arrived
        for step in range(thought.basis, min(end, trajectory.steps)):
            acted = any(m.player == thought.seat and m.applied for m in trajectory.moves[step])
            if not acted and not trajectory.states[step].busy_steps(thought.seat):
                lost.add((thought.seat, step))
    return len(lost)


def contributions(trajectory: Trajectory) -> dict[str, float]:
    """Return each player's share of the applied actions, without waiting and walking.

    The shares sum to 1, or are all 0 without actions. Overcooked-AI studies report "agent
    contribution" in this way, over dishes and ingredients.
    """
    counts = dict.fromkeys(trajectory.world.players, 0)
    for joint in trajectory.moves:
        for move in joint:
            if move.applied and not (is_waiting(move.action) or is_travel(move.action)):
                counts[move.player] += 1
    total = sum(counts.values())
    return {player: count / total if total else 0.0 for player, count in counts.items()}


def blocking(trajectory: Trajectory) -> int:
    """Return the number of actions that were rejected because of another player.

    Either another player stands at the station, or another action in the same step made the action
    impossible.
    """
    occupied = _occupied_predicates(trajectory.world.task.domain)
    count = 0
    for before, joint, _ in trajectory.each_step():
        for move in joint:
            if not move.applied:
                outrun = trajectory.world.applicable(before, move.action)
                count += outrun or _is_blocked(move.unmet, occupied)
    # A rejected move is also an answer; it must not count twice.
    moved = {
        (step, move.player)
        for step, joint in enumerate(trajectory.moves)
        for move in joint
        if not move.applied
    }
    for answer in trajectory.answers:
        if answer.wrong and (answer.step, answer.seat) not in moved:
            count += _is_blocked(answer.unmet, occupied)
    return count


def _is_blocked(unmet: tuple[Unmet, ...], occupied: frozenset[str]) -> bool:
    """Return whether the only unmet conditions say that another player is at the station."""
    return bool(unmet) and all(
        each.kind is UnmetKind.CONDITION and each.predicate in occupied for each in unmet
    )


def _occupied_predicates(domain: DomainFile) -> frozenset[str]:
    """Return the predicates that mean that no player stands at a station, such as `vacant`."""
    rules = domain.layout or ()
    facing = {rule.predicate for rule in rules if rule.when == "faces"}
    return frozenset(rule.predicate for rule in rules if facing.intersection(rule.unless or ()))


def overlap(trajectory: Trajectory) -> float | None:
    """Return the share of steps in which at least two players act or are busy.

    Waiting is not an action. In scheduling this is the parallel share of a schedule.

    Returns:
        None for one player, and without steps.
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


ALONE, TOGETHER = Limits(expansions=2000), Limits(expansions=0)
FIRST = Limits(expansions=50)
"""Search for the first plan of a team without a known plan."""


def measure(
    trajectory: Trajectory,
    budget: int,
    *,
    distance: StepsToGo | None = None,
    fewest: int | None = None,
    limits: Limits | None = None,
) -> EpisodeMeasures:
    """Return the measures of a row.

    Args:
        budget: Steps within which the goal should be reached.
        distance: Steps to go in the trajectory's world; not measured if None. One object for all
            episodes of a task remembers its results.
        fewest: Proven number of steps from the first state to the goal.
        limits: Limits of each search for steps to go. If None, 2,000 expansions for one player.
            Searches for teams take a hundred times as long, so none is made for them. A plan is
            carried out from the last state instead: the known one (`StepsToGo.learn`), or else one
            found from the first state.
    """
    shares, overcome = time_shares(trajectory), recovery(trajectory)
    late = late_answers(trajectory)
    found = EpisodeMeasures(
        asynchronous_first=asynchronous_first(trajectory),
        stumbles=overcome.stumbles,
        recovered=overcome.recovered,
        repeated_mistakes=overcome.repeated,
        waiting_share=shares.waiting if shares else None,
        idle_share=shares.idle if shares else None,
        contributions=contributions(trajectory) if len(trajectory.world.players) > 1 else {},
        blocked=blocking(trajectory),
        overlap=overlap(trajectory),
        staleness=staleness(trajectory),
        late_answers=late.count,
        held_share=late.share,
        lost_to_thinking=lost_to_thinking(trajectory),
        failure=_failure_row(classify(trajectory, budget)),
    )
    if distance is None:
        return found
    if limits is None:
        limits = default_limits(trajectory.world)
        if limits is TOGETHER and distance.known(trajectory.world.initial).steps is None:
            distance(trajectory.world.initial, FIRST)
    left = steps_to_go_at_the_end(trajectory, distance, limits, fewest)
    if left is None:
        return found.model_copy(update={"out_of_reach": not success_within(trajectory, budget)})
    return found.model_copy(update={"to_go_least": left.least, "to_go_most": left.most})


def default_limits(world: World) -> Limits:
    """Return the default limits of searches for steps to go."""
    return ALONE if len(world.players) == 1 else TOGETHER


def _failure_row(failure: Failure | None) -> FailureRow | None:
    if failure is None:
        return None
    return FailureRow(
        category=failure.category,
        subcategory=failure.subcategory.value,
        steps=failure.steps,
    )
