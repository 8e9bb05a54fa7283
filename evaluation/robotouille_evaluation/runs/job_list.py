"""Plan of a run as data: which agent plays which instance with which seed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from robotouille.episode.rules import StepRate
from robotouille.errors import RobotouilleError, WrongArgumentError
from robotouille_evaluation.agents.making import team_strategy
from robotouille_evaluation.agents.team import Control
from robotouille_evaluation.metrics.rows import MAX_NUMBER
from robotouille_evaluation.packs.budget import Budget, BudgetKind
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.realtime import Charge, LatePolicy
from robotouille_evaluation.runs.budgets import GoalBudget, common_rule

Variant = Literal["", "stochastic", "stochastic-paper", "delay-free"]
"""Unchanged; a cut item reverts by chance, with the probability of the published code or of the
paper (`chance`); or nothing takes time (`packs.delay_free`)."""
HelperKind = Literal["none", "planner", "script"]


class RealTime(BaseModel):
    """Settings of a world that moves on while models think.

    Attributes:
        step_rate: Steps per second.
        charge: Cost of a thought (see `Charge.parse`).
        late: Rule for late answers.
        helper: Policy that acts while a model thinks.
        digest_tokens: Longest digest of changes that a model is shown.
        max_age: Most steps between an observation and the answer to it; unlimited if None.
        slack: Factor of the step limit.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    step_rate: StepRate = 5.0
    charge: str
    late: LatePolicy = LatePolicy.APPLY
    helper: HelperKind = "none"
    digest_tokens: int = Field(default=0, ge=0)
    max_age: int | None = Field(default=None, ge=0, le=MAX_NUMBER)
    slack: float = Field(default=1.0, ge=1, le=1000)

    @field_validator("charge")
    @classmethod
    def _check_charge(cls, charge: str) -> str:
        parsed = Charge.parse(charge)
        if not parsed.repeats:
            raise WrongArgumentError(
                "a charge by the wall clock is not repeatable; "
                "use tokens:MILLISECONDS or declared:MILLISECONDS"
            )
        return str(parsed)


class AgentSpec(BaseModel):
    """Agent of a run.

    Attributes:
        kind: `custom` for a policy of the user's, named as `MODULE:NAME`.
        strategy: Strategy of a language model, or the id of an experiment of the pack.
        parameters: Parameters of each request.
        prices: Prices of a million tokens sent and received, such as `0.40/1.20`; list prices if
            empty.
        timeout: Seconds for an attempt; the endpoint's default if None.
        attempts: Most requests for one answer; the endpoint's default if None.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str
    kind: Literal["planner", "random", "scripted", "custom", "model"]
    strategy: str = ""
    model: str = ""
    base_url: str = ""
    parameters: dict[str, Any] = Field(default_factory=dict)
    prices: str = ""
    timeout: float | None = Field(default=None, gt=0)
    attempts: int | None = Field(default=None, ge=1)

    @property
    def sampling(self) -> str:
        """Parameters of the requests in words, such as `temperature 0.7`."""
        return sampling_words(self.parameters)


def sampling_words(parameters: Mapping[str, object]) -> str:
    """Return parameters of requests in words; empty for the endpoint's own."""
    return ", ".join(
        f"{name.replace('_', ' ')} {f'{value:g}' if isinstance(value, float) else value}"
        for name, value in parameters.items()
    )


def model_agent_name(strategy: str, model: str, parameters: Mapping[str, object]) -> str:
    """Return the name of an agent, which distinguishes strategies, models and sampling."""
    return f"{strategy} ({', '.join(filter(None, (model, sampling_words(parameters))))})"


NOT_PLAYED = {"prices", "timeout", "attempts"}
"""Fields of an agent that have no influence on its play."""


class EpisodeJob(BaseModel):
    """One episode to play.

    Attributes:
        seed: Seed of the agent's random choices.
        real_time: Real time settings; None if the world waits for its players.
        control: How one model, or several, control the seats of a team.
        experiment: Experiment of the pack whose budget applies, if any.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    agent: AgentSpec
    instance: str
    seats: int
    seed: int = Field(ge=-MAX_NUMBER, le=MAX_NUMBER)
    budget: BudgetKind
    variant: Variant = ""
    real_time: RealTime | None = None
    control: Control = "each"
    experiment: str = ""

    @model_validator(mode="after")
    def _is_playable(self) -> EpisodeJob:
        if self.control != "each" and (self.real_time is not None or self.agent.kind != "model"):
            raise ValueError(
                f"control {self.control!r} requires language models in a world that waits"
            )
        return self

    @property
    def id(self) -> str:
        """Hash that is the same for the same job in every process. It names the job's files."""
        content = self.model_dump(exclude={"agent": NOT_PLAYED})
        # Ids of jobs without these options do not depend on their existence.
        if not self.variant:
            del content["variant"]
        if self.real_time is None:
            del content["real_time"]
        elif self.real_time.max_age is None:
            del content["real_time"]["max_age"]
        if self.control == "each":
            del content["control"]
        if not self.experiment:
            del content["experiment"]
        text = json.dumps(content, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    @property
    def clock(self) -> str:
        """Clock of the episode."""
        if self.real_time is not None:
            return "realtime"
        return "turn" if self.seats == 1 else "lockstep"

    @property
    def slack(self) -> float:
        """Factor of the step limit."""
        return 1.0 if self.real_time is None else self.real_time.slack

    def step_budget(self, pack: Pack) -> Budget:
        """Return the step budget, with the constants of the experiment if it plays the task.

        Raises:
            RobotouilleError: The instance has no such budget, or the experiment is unknown.
        """
        instance = pack.instance(self.instance)
        if self.budget == "published" and self.experiment:
            found = pack.experiment(self.experiment).budget(instance.task)
            if found is not None:
                return found
        return pack.budget(instance, self.budget, seats=self.seats)


@dataclass(frozen=True, slots=True)
class JobOptions:
    """Options of a run's jobs.

    Args:
        seeds: Seeds with which each agent plays.
        seats: Number of players for tasks that allow several; the usual number if None.
        budget: Rule of the step budget. If None, `own` if plans of all instances are known, and
            `published` if none is. A shift has its own length.
        variant: Variant to play; for `delay-free` the pack must be one without delays. If None,
            experiments of the pack choose it themselves.
        real_time: Real time settings; None if the world waits.
        control: How one model, or several, control a team. Other agents, and models that play
            alone, always have the control `each`.
        experiment: Experiment of the pack whose budget applies, if any.
    """

    seeds: Iterable[int] = (0,)
    seats: int | None = None
    budget: GoalBudget | None = None
    variant: Variant | None = None
    real_time: RealTime | None = None
    control: Control = "each"
    experiment: str = ""


def plan_jobs(
    pack: Pack,
    agents: Iterable[AgentSpec],
    instances: Iterable[PackInstance],
    options: JobOptions = JobOptions(),  # frozen
) -> Iterator[EpisodeJob]:
    """Yield a job for each instance, agent and seed, instance by instance.

    Raises:
        RobotouilleError: A budget is unknown, no budget is chosen and none fits all instances, two
            agents have the same name, an agent cannot play with this control, or a task is not for
            that many seats.
    """
    agents, instances = tuple(agents), tuple(instances)
    seats, control, real_time = options.seats, options.control, options.real_time
    _check_names(agents)
    if seats is not None:
        pack.require_seats(instances, seats)
    if control != "each":
        _check_control(control, pack, agents, real_time)
        if not any((each.seats if seats is None else seats) > 1 for each in instances):
            raise RobotouilleError(
                f"--control {control} is for teams, and no task here has several robots"
            )
    seeds = tuple(options.seeds)
    goal_rule = options.budget or common_rule(pack, instances, seats)
    for instance in instances:
        count = instance.seats if seats is None else seats
        rule = _budget_rule(pack, instance, goal_rule, options)
        for agent in agents:
            _check_playable(agent, instance, rule, count, real_time)
            for seed in seeds:
                job = EpisodeJob(
                    agent=agent,
                    instance=instance.id,
                    seats=count,
                    seed=seed,
                    budget=rule,
                    variant=_variant(pack, agent, options),
                    real_time=real_time,
                    control=control if agent.kind == "model" and count > 1 else "each",
                    experiment=options.experiment,
                )
                job.step_budget(pack)  # raises an error without a budget
                yield job


def _budget_rule(
    pack: Pack, instance: PackInstance, goal_rule: GoalBudget, options: JobOptions
) -> BudgetKind:
    if pack.shift(instance) is not None:
        if options.real_time is not None and options.real_time.slack != 1:
            raise RobotouilleError(f"{instance.id} is a shift, which cannot be longer: no --slack")
        return "shift"
    return goal_rule


def _variant(pack: Pack, agent: AgentSpec, options: JobOptions) -> Variant:
    if options.variant is not None:
        return options.variant
    found = next((each for each in pack.experiments if each.id == agent.strategy), None)
    return "stochastic" if found is not None and found.stochastic else ""


def _check_playable(
    agent: AgentSpec,
    instance: PackInstance,
    rule: BudgetKind,
    seats: int,
    real_time: RealTime | None,
) -> None:
    """Raise RobotouilleError for an episode that could only fail."""
    helped = agent.kind == "model" and real_time is not None and real_time.helper == "script"
    if (agent.kind == "scripted" or helped) and instance.best(seats) is None:
        what, instead = (
            ("--helper script", "use --helper planner")
            if helped
            else ("`scripted`", "remove it from --agents")
        )
        # No plan can be found for a shift, because it has no goal.
        prove = "" if rule == "shift" else ", or find plans with `robotouille pack prove` first"
        raise RobotouilleError(
            f"{what} needs a plan, and none is known for {instance.id}: {instead}{prove}"
        )
    if agent.strategy.casefold().startswith("reflexion") and seats > 1:
        raise RobotouilleError(
            f"{agent.name} starts again after a failure, so it plays alone; "
            f"{instance.id} is for {seats} players"
        )


def _check_control(
    control: Control, pack: Pack, agents: Iterable[AgentSpec], real_time: RealTime | None
) -> None:
    """Raise RobotouilleError for agents that do not support a control."""
    if real_time is not None:
        raise RobotouilleError(
            f"--control {control} is not possible in real time, "
            "where each robot has a model of its own"
        )
    for agent in agents:
        if agent.kind == "model":
            team_strategy(pack, agent.strategy, pack.datasets[0], control)


def _check_names(agents: Iterable[AgentSpec]) -> None:
    seen: set[str] = set()
    for agent in agents:
        if agent.name in seen:
            raise RobotouilleError(f"two agents are named {agent.name!r}; rename one of them")
        seen.add(agent.name)
