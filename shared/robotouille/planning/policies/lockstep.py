"""Episodes that policies play together in lockstep, without a server or a clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from robotouille.planning.plan import Plan
from robotouille.planning.policies.policy import Policy, TeamPolicy
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State


def play_in_lockstep(
    start: State,
    policies: Mapping[str, Policy],
    max_steps: int,
    *,
    watch: Callable[[State], None] = lambda state: None,
) -> tuple[Plan, State]:
    """Return the applied actions of policies in all seats, and the last state.

    The episode ends at the goal, at the end of a shift, or after `max_steps`. All policies decide
    on the same state. Equal policies take equal steps.

    Args:
        policies: The policy of each player.
        watch: Function that is called with the state after each step.
    """
    talkers = {p: each for p, each in policies.items() if isinstance(each, TeamPolicy)}
    for talker in talkers.values():
        talker.meet(dict.fromkeys(policies, "bot"), "lockstep")
    state, steps = start, list[tuple[GroundAction, ...]]()
    while len(steps) < max_steps and not (state.goal_reached or state.shift_over):
        decided = [
            (bool(getattr(policy, "anticipating", False)), player, action)
            for player, policy in policies.items()
            if not state.busy_steps(player) and (action := policy.act(state)) is not None
        ]
        # An action that relies on another one of the same step comes after it.
        decided.sort(key=lambda each: each[0])
        step = state.step([action for _, _, action in decided])
        steps.append(tuple(each.action for each in step.attempts if each.applied))
        # The players are those who decided, because an action without a player may be anybody's.
        did = [
            (player, each.action, each.applied)
            for (_, player, _), each in zip(decided, step.attempts, strict=True)
        ]
        for policy in policies.values():
            policy.observe(did)
        for player, talker in talkers.items():
            for speech in talker.speak():
                for other in talkers.values():
                    other.hear(player, speech)
        state = step.state
        watch(state)
    return Plan(tuple(steps)), state
