"""Leave out of a plan what it does not need."""

from __future__ import annotations

from robotouille.planning.plan import Joint, Plan
from robotouille.world.world import State

__all__ = ["eliminate_actions"]


def eliminate_actions(plan: Plan, start: State) -> Plan:
    """The plan without the actions whose absence neither delays nor endangers the goal."""
    steps = list(plan.steps)
    states = _run(steps, start)
    for number in reversed(range(len(steps))):
        for action in reversed(steps[number]):
            shorter = tuple(a for a in steps[number] if a is not action)
            rest = [shorter, *steps[number + 1 :]]
            after = _run(rest, states[number])
            if len(after) <= len(rest) or not after[-1].goal_reached:
                continue
            steps[number] = shorter
            states[number + 1 :] = after[1:]
    return Plan(tuple(steps))


def _run(steps: list[Joint], start: State) -> list[State]:
    """The states from the start on; fewer than there are steps and one if an action fails."""
    states = [start]
    for joint in steps:
        step = states[-1].step(joint)
        if not all(attempt.applied for attempt in step.attempts):
            break
        states.append(step.state)
    return states
