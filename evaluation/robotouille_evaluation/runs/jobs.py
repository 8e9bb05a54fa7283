"""Which agent plays what, how often: the plan of a run, as data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from robotouille.episode.rules import StepRate
from robotouille.errors import RobotouilleError, WrongArgumentError
from robotouille_evaluation.agents.making import team_strategy
from robotouille_evaluation.agents.teams.team import Control
from robotouille_evaluation.metrics.rows import MAX_NUMBER
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.realtime import Charge, Late
from robotouille_evaluation.runs.variants import Variant

__all__ = ["AgentSpec", "HelperKind", "Job", "RealTime", "jobs"]

HelperKind = Literal["none", "planner", "script"]


class RealTime(BaseModel):
    """How the world moves on while models think.

    `step_rate` is in steps a second, `charge` says what a thought costs (`Charge.parse`), `late`
    what becomes of late answers (`Late`), `helper` who acts meanwhile. `digest_tokens` is how long
    the digest may be of what has changed; `slack` by how much the limit of steps is multiplied.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    step_rate: StepRate = 5.0
    charge: str
    late: Late = Late.APPLY
    helper: HelperKind = "none"
    digest_tokens: int = Field(default=0, ge=0)
    slack: float = Field(default=1.0, ge=1, le=1000)

    @field_validator("charge")
    @classmethod
    def _check_charge(cls, charge: str) -> str:
        parsed = Charge.parse(charge)
        if not parsed.repeats:
            raise WrongArgumentError(
                "what is charged by the wall clock does not repeat; "
                "a benchmark takes tokens:MILLISECONDS or declared:MILLISECONDS"
            )
        return str(parsed)


class AgentSpec(BaseModel):
    """Who plays. `strategy` is that of a language model, or the id of a pack's experiment."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str
    kind: Literal["planner", "random", "scripted", "model"]
    strategy: str = ""
    model: str = ""
    base_url: str = ""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """Sent with each request."""
    prices: str = ""
    """Of a million tokens sent and received, e.g. `0.40/1.20`; unknown if empty."""
    timeout: float | None = Field(default=None, gt=0)
    """Seconds for an attempt; the endpoint's usual ones if None."""
    attempts: int | None = Field(default=None, ge=1)
    """How often the endpoint is asked at most; the usual number if None."""


HOW_IT_IS_ASKED = {"prices", "timeout", "attempts"}
"""What says nothing of what is played."""


class Job(BaseModel):
    """One episode to be played."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    agent: AgentSpec
    instance: str
    seats: int
    seed: int = Field(ge=-MAX_NUMBER, le=MAX_NUMBER)
    """Of the agent's chance."""
    budget: Literal["published", "own"]
    variant: Variant = ""
    real_time: RealTime | None = None
    """None where the world waits for its players."""
    control: Control = "each"
    """How many models a team has, and how they are asked."""

    @model_validator(mode="after")
    def _is_playable(self) -> Job:
        if self.control != "each" and (self.real_time is not None or self.agent.kind != "model"):
            raise ValueError(
                f"control {self.control!r} is for language models in a world that waits"
            )
        return self

    @property
    def id(self) -> str:
        """The same for the same job in every process: names files, and is found again."""
        told = self.model_dump(exclude={"agent": HOW_IT_IS_ASKED})
        if not self.variant:
            del told["variant"]  # Runs that were begun before there were variants go on.
        if self.real_time is None:
            del told["real_time"]
        if self.control == "each":
            del told["control"]
        text = json.dumps(told, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]


def jobs(
    pack: Pack,
    agents: Iterable[AgentSpec],
    instances: Iterable[PackInstance],
    *,
    seeds: Iterable[int] = (0,),
    seats: int | None = None,
    budget: Literal["published", "own"] | None = None,
    variant: Variant = "",
    real_time: RealTime | None = None,
    control: Control = "each",
) -> Iterator[Job]:
    """Every agent on every instance with every seed, instance by instance.

    Args:
        seats: How many players, where a task leaves it open; the usual number if None.
        variant: Is played; for `delay-free`, the pack is one without delays. If none is named,
            an experiment of the pack is played as it says itself.
        real_time: How the world moves on meanwhile; it waits if None.
        budget: Which limit of steps; if None, `own` where a plan is known, else `published`.
        control: How the seats of a language model's team are asked. What plans, and who plays
            alone, is `each`.

    Raises:
        RobotouilleError: No number is known of which the budget could be made, two agents of
            one name could not be told apart, an agent cannot play under this control, or a task
            is not for so many seats.
    """
    agents, instances, seeds = tuple(agents), tuple(instances), tuple(seeds)
    _check_names(agents)
    if seats is not None:
        pack.require_seats(instances, seats)
    if control != "each":
        _check_control(control, pack, agents, real_time)
        if not any((each.seats if seats is None else seats) > 1 for each in instances):
            raise RobotouilleError(f"no task here is for several robots: no --control {control}")
    for instance in instances:
        count = instance.seats if seats is None else seats
        kind = budget or ("own" if instance.best(count) is not None else "published")
        pack.budget(instance, kind, seats=count)
        for agent in agents:
            _check_playable(agent, instance, count, real_time)
            for seed in seeds:
                yield Job(
                    agent=agent,
                    instance=instance.id,
                    seats=count,
                    seed=seed,
                    budget=kind,
                    variant=variant or _own_variant(pack, agent),
                    real_time=real_time,
                    control=control if agent.kind == "model" and count > 1 else "each",
                )


def _own_variant(pack: Pack, agent: AgentSpec) -> Variant:
    found = next((each for each in pack.experiments if each.id == agent.strategy), None)
    by_chance = found is not None and found.settings.get("game", {}).get("stochastic")
    return "stochastic" if by_chance else ""


def _check_playable(
    agent: AgentSpec, instance: PackInstance, seats: int, real_time: RealTime | None
) -> None:
    """Raises RobotouilleError for what could only break off."""
    helped = agent.kind == "model" and real_time is not None and real_time.helper == "script"
    if (agent.kind == "scripted" or helped) and instance.best(seats) is None:
        what, instead = (
            ("--helper script", "take --helper planner")
            if helped
            else ("`scripted`", "leave it out of --agents")
        )
        raise RobotouilleError(
            f"no plan of {instance.id} is known that {what} could carry out: {instead}, "
            "or let `robotouille pack prove` find plans first"
        )
    if agent.strategy.casefold().startswith("reflexion") and seats > 1:
        raise RobotouilleError(
            f"{agent.name} begins anew after a failure, alone; {instance.id} is for {seats} players"
        )


def _check_control(
    control: Control, pack: Pack, agents: Iterable[AgentSpec], real_time: RealTime | None
) -> None:
    """Raises RobotouilleError for agents that cannot be asked so."""
    if real_time is not None:
        raise RobotouilleError(
            f"the world does not wait in real time, where each robot has a model of its own: "
            f"no --control {control}"
        )
    for agent in agents:
        if agent.kind == "model":
            team_strategy(pack, agent.strategy, pack.datasets[0], control)


def _check_names(agents: Iterable[AgentSpec]) -> None:
    seen: set[str] = set()
    for agent in agents:
        if agent.name in seen:
            raise RobotouilleError(f"two agents are called {agent.name!r}; give one another name")
        seen.add(agent.name)
