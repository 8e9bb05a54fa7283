"""Skill of a bot: how quickly it reacts and works, how far it thinks ahead, how often it errs.

A planner bot acts in every step, so nothing is left for the people in its kitchen. `SkilledPolicy`
slows any policy down to a human level. Times are in seconds and hold in real-time games only. In
games that wait for each player, a skill changes what a bot does, not when.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, fields

from robotouille.errors import RobotouilleError, did_you_mean
from robotouille.planning.policies.policy import Did, Policy, Speech, TeamPolicy, think, waits
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State


@dataclass(frozen=True, slots=True)
class Skill:
    """Parameters of a bot's skill. The defaults change nothing.

    Attributes:
        reaction: Seconds from the moment when an action becomes possible to the action.
        pace: Minimum number of seconds between the starts of two actions.
        rest: Share of its working time that the bot leaves to others, from 0 to below 1. After
            each piece of work it rests for this share of the time. Several bots next to people
            who do nothing rest longer: k bots work as much as the square root of k bots.
        slips: Probability that a walk leads to a wrong place.
        looks_ahead: False for a bot that waits next to what it cooks instead of doing other work.
    """

    reaction: float = 0.0
    pace: float = 0.0
    rest: float = 0.0
    slips: float = 0.0
    looks_ahead: bool = True

    def __str__(self) -> str:
        """Return the parameters that differ from the defaults, such as `reaction=0.4 pace=0.8`."""
        changed = ((f.name, getattr(self, f.name)) for f in fields(self))
        return " ".join(f"{name}={value}" for name, value in changed if value != _default(name))


def _default(name: str) -> object:
    return next(f.default for f in fields(Skill) if f.name == name)


EXPERT = Skill()
SKILLS: Mapping[str, Skill] = {
    "learner": Skill(reaction=1.0, pace=1.2, rest=0.4, slips=0.08, looks_ahead=False),
    "partner": Skill(reaction=0.4, pace=0.8, rest=0.3, slips=0.02),
    "expert": EXPERT,
}
"""Skills by name, from low to high."""


def skill_named(name: str) -> Skill:
    """Return a skill.

    Raises:
        RobotouilleError: There is no skill of this name.
    """
    if name not in SKILLS:
        raise RobotouilleError(
            f"unknown skill {name!r}{did_you_mean(name, SKILLS)} (possible: {', '.join(SKILLS)})"
        )
    return SKILLS[name]


MAX_REST = 3.0
"""Maximum number of seconds of one rest."""

HELPED = 20.0
"""Seconds after a person's work for which several bots rest no longer than one."""


class SkilledPolicy:
    """Policy that carries out another policy's decisions with limited skill.

    Equal seeds and events give equal actions.

    Args:
        skill: None for a partner in real-time games with people, and an expert in all others.
        step_seconds: Duration of a step in a real-time game; 0 in games that wait for players.
    """

    def __init__(
        self,
        policy: Policy,
        player: str,
        skill: Skill | None,
        *,
        step_seconds: float,
        seed: int = 0,
    ) -> None:
        self._policy = policy
        self._player = player
        self._skill = skill or EXPERT
        self._rest = self._skill.rest
        self._people: frozenset[str] = frozenset()
        self._helped = -math.inf
        self._fits_company = skill is None
        self._rate = 1 / step_seconds if step_seconds else 0.0
        self._random = random.Random(f"{seed}:{player}:skill")
        self._step = 0
        self._ready = 0
        self._worked = 0.0
        # Someone who had nothing to do reacts late. Someone at work knows what comes next.
        self._alert = True
        self._watched: GroundAction | None = None
        self._resting = False

    @property
    def anticipating(self) -> bool:
        """True if the last action relies on another seat's action in the same step."""
        return isinstance(self._policy, TeamPolicy) and self._policy.anticipating

    @property
    def waiting(self) -> bool:
        """True if the seat waits for a place or a participant, not if it rests."""
        return not self._resting and waits(self._policy)

    def act(self, state: State) -> GroundAction | None:
        self._resting = True
        if self._step < self._ready or self._stands_by(state):
            think(self._policy, state)
            return None
        action = self._policy.act(state)
        self._resting = False
        if action is None:
            self._alert = False
            return None
        if not self._alert and self._pause(self._skill.reaction):
            self._resting = self._alert = True
            return None
        return self._slip(state, action)

    def _stands_by(self, state: State) -> bool:
        """Return whether the seat watches an effect that it has started."""
        if self._watched is None:
            return False
        name, things = self._watched.name, {*self._watched.arguments}
        return any(
            row.timed and row.running and row.action == name and things.issuperset(row.arguments)
            for row in state.progress()
        )

    def _slip(self, state: State, action: GroundAction) -> GroundAction:
        """Return an action, or sometimes a walk to a wrong place instead of a right one."""
        if action.destination is None or self.anticipating:
            return action
        if self._random.random() >= self._skill.slips:
            return action
        walks = [a for a in state.actions(self._player) if a.destination is not None]
        return self._random.choice(walks)

    def _pause(self, seconds: float) -> bool:
        """Do nothing for some time from the current step; return whether that is any time."""
        steps = round(seconds * self._rate)
        self._ready = max(self._ready, self._step + steps)
        return steps > 0

    # Events

    def observe(self, did: Did) -> None:
        self._step += 1
        for player, action, applied in did:
            if player in self._people and applied and action.destination is None:
                self._helped = self._step
            if player == self._player and applied and (action.touched or action.effects):
                self._note(action)
        self._policy.observe(did)

    def _note(self, action: GroundAction) -> None:
        """Plan the pauses after an action of this seat."""
        skill = self._skill
        self._alert = True
        if not skill.looks_ahead:
            self._watched = action
        if not self._rate:
            return
        step = 1 / self._rate
        taken = max(action.duration * step, skill.pace)
        # One step has passed since the action began, and the player is busy for its duration.
        self._pause(taken - step)
        self._worked += taken
        if action.destination is None and self._rest:
            # A person who helps must not make the game longer, however slow the person is.
            helped = self._step - self._helped < HELPED * self._rate
            share = self._skill.rest if helped else self._rest
            rest = min(self._worked * share / (1 - share), MAX_REST)
            self._ready += round(rest * self._rate)
            self._worked = 0.0

    def meet(self, kinds: Mapping[str, str], clock: str) -> None:
        self._people = frozenset(p for p, kind in kinds.items() if kind == "human")
        people = len(self._people)
        if self._fits_company:
            self._skill = SKILLS["partner"] if people and clock == "realtime" else EXPERT
        self._rest = self._skill.rest
        if people and self._rest:
            # Two bots that rest as little as one leave a person nothing to win.
            bots = max(1, len(kinds) - people)
            self._rest = 1 - (1 - self._rest) / math.sqrt(bots)
        if isinstance(self._policy, TeamPolicy):
            self._policy.meet(kinds, clock)

    def hear(self, player: str, speech: Speech) -> None:
        if isinstance(self._policy, TeamPolicy):
            self._policy.hear(player, speech)

    def speak(self) -> list[Speech]:
        return self._policy.speak() if isinstance(self._policy, TeamPolicy) else []
