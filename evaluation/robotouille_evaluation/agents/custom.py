"""Agents of the user's own: `robotouille benchmark run --agents MODULE:NAME`.

Installed packages may register agents under a name of their own (`GROUP`).

A policy chooses actions itself, as for `robotouille-bot MODULE:NAME`. A strategy is a class with a
method `propose`, which asks a model.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from robotouille.planning.policies import Did
from robotouille_client.bots.own_policy import OwnPolicyError, load_own, own_error, own_errors
from robotouille_evaluation.agents.proposal import (
    AgentObservation,
    ContextOverflow,
    Exchange,
    ExchangeVerdict,
    Proposal,
    ProposalSteps,
    Strategy,
)
from robotouille_evaluation.models import Completion, ModelRequest

MAX_IN_VAIN = 3
"""Proposals in a row without an action after which an agent has finished."""


GROUP = "robotouille.agents"
"""Group of entry points, whose values are `MODULE:NAME`."""


def installed_agents() -> dict[str, str]:
    """Return the agents that installed packages register: `MODULE:NAME` by name.

    Others are left out; see `broken_agents`.
    """
    return {entry.name: target for entry in _registered() if (target := _target(entry))}


def broken_agents() -> dict[str, str]:
    """Return why agents that installed packages register cannot be used, by name."""
    working = installed_agents()
    return {
        entry.name: f"the package {entry.dist.name if entry.dist else '?'} registers "
        f"{entry.value!r}, which is not MODULE:NAME"
        for entry in _registered()
        if entry.name not in working
    }


def _registered() -> list[EntryPoint]:
    return sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value))


def _target(entry: EntryPoint) -> str:
    """Return the entry's `MODULE:NAME`, or an empty string if its value is something else."""
    if not EntryPoint.pattern.fullmatch(entry.value) or not entry.attr:
        return ""
    return f"{entry.module}:{entry.attr}"


def is_custom(name: str) -> bool:
    """Return whether an agent is named as `MODULE:NAME`."""
    return ":" in name


def asks_a_model(name: str) -> bool:
    """Return whether `MODULE:NAME` is a strategy rather than a policy.

    Raises:
        RobotouilleError: The module or name is missing.
    """
    found, _ = load_own(name)
    return inspect.isclass(found) and callable(getattr(found, "propose", None))


def custom_strategy(name: str) -> Strategy:
    """Return a new strategy of the class `MODULE:NAME`.

    Raises:
        RobotouilleError: The module or name is missing, or the class raises.
    """
    found, file = load_own(name)
    with own_errors(name, file):
        return _CustomStrategy(found(), name, file)


class _CustomStrategy:
    """Adapter of a user's strategy, which needs no method but `propose`.

    It records the requests, so that tokens and costs are counted.
    """

    def __init__(self, strategy: Any, name: str, file: str) -> None:
        self._strategy = strategy
        self._name = name
        self._file = file
        self._in_vain = 0

    @property
    def retries_left(self) -> int:
        """Number of further retries; none by default."""
        return int(getattr(self._strategy, "retries_left", 0))

    def observe(self, did: Did) -> None:
        """Pass on what all players did in a step."""
        if hasattr(self._strategy, "observe"):
            with own_errors(f"{self._name}.observe", self._file):
                self._strategy.observe(did)

    def retry(self) -> bool:
        """Return whether to start the episode again."""
        if not hasattr(self._strategy, "retry"):
            return False
        with own_errors(f"{self._name}.retry", self._file):
            return bool(self._strategy.retry())

    def propose(self, observation: AgentObservation) -> ProposalSteps:
        """Propose actions, and record the requests of the user's strategy."""
        asked: list[tuple[ModelRequest, Completion]] = []
        found = yield from self._asking(observation, asked)
        proposal = Proposal((found,)) if isinstance(found, str) else found
        if not isinstance(proposal, Proposal):
            kind = type(found).__name__
            raise OwnPolicyError(
                f"{self._name}.propose returned {kind}; expected an action's sentence or a Proposal"
            )
        self._in_vain = 0 if proposal.actions else self._in_vain + 1
        # An episode waits for an action, so a strategy without one must not be asked for ever.
        done = proposal.done or self._in_vain >= MAX_IN_VAIN
        exchanges = proposal.exchanges or _exchanges(asked, proposal)
        return replace(proposal, done=done, exchanges=exchanges)

    def _asking(
        self, observation: AgentObservation, asked: list[tuple[ModelRequest, Completion]]
    ) -> Generator[ModelRequest, Completion, Any]:
        what = f"{self._name}.propose"
        with own_errors(what, self._file):
            steps = self._strategy.propose(observation)
        if not inspect.isgenerator(steps):
            return steps  # It asked nothing.
        resume: Callable[[Any], Any] = steps.send
        value: Any = None
        while True:
            try:
                request = resume(value)
            except StopIteration as stop:
                return stop.value
            except ContextOverflow:
                raise
            except Exception as error:
                raise own_error(what, self._file, error) from error
            if not isinstance(request, ModelRequest):
                raise OwnPolicyError(
                    f"{what} yielded {type(request).__name__}; expected a ModelRequest"
                )
            try:
                answer = yield request
            except ContextOverflow as overflow:
                resume, value = steps.throw, overflow
            else:
                asked.append((request, answer))
                resume, value = steps.send, answer


def _exchanges(
    asked: Sequence[tuple[ModelRequest, Completion]], proposal: Proposal
) -> tuple[Exchange, ...]:
    """Return the exchanges behind a proposal. The last answer counts as the one that decided."""
    # The episode checks the actions when it takes them, as those of a plan.
    verdict = ExchangeVerdict.PLAN if proposal.actions else ExchangeVerdict.NO_ACTION
    action = proposal.actions[0] if proposal.actions else ""
    earlier = [Exchange(*each, ExchangeVerdict.REFLECTION) for each in asked[:-1]]
    last = [Exchange(*each, verdict, proposal.reasoning, action) for each in asked[-1:]]
    return (*earlier, *last)
