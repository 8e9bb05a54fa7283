"""Options of `robotouille benchmark run` and `resume`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from robotouille_client.bots.llm_options import (
    AttemptsOption,
    DigestTokensOption,
    LateOption,
    MaxAgeOption,
    ModelOptions,
    TimeoutOption,
)


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Limits on what a run does at the same time."""

    processes: Annotated[
        int, typer.Option("--processes", min=1, help="Processes for agents without a model.")
    ] = os.cpu_count() or 1
    calls: Annotated[
        int, typer.Option("--calls", min=1, help="Episodes that wait for a model at once.")
    ] = 16
    scheduler: Annotated[
        str, typer.Option("--scheduler", help="Address of a Dask scheduler to use for processes.")
    ] = ""


@dataclass(frozen=True, kw_only=True)
class ResumeOptions(WorkerOptions):
    """Options of a resumed run."""

    timeout: TimeoutOption = None
    attempts: AttemptsOption = None
    base_url: Annotated[
        str,
        typer.Option(help="Endpoint of the run, repeated to confirm that it may receive a key."),
    ] = ""
    agents: Annotated[
        str,
        typer.Option(
            help="Agents MODULE:NAME of the run, repeated to confirm that their code may run."
        ),
    ] = ""


@dataclass(frozen=True, kw_only=True)
class RunOptions(WorkerOptions, ModelOptions):
    """Options of a new run."""

    agents: Annotated[
        str,
        typer.Option(
            "--agents",
            help="Agents: planner, random, scripted, or strategies of a language model "
            "(`robotouille benchmark agents`). Default: planner,random,scripted, or the agents of "
            "--experiment.",
        ),
    ] = ""
    experiment: Annotated[
        str,
        typer.Option(
            help="Experiments of the pack to play as published: agent, tasks, instances, "
            "temperature, step budget and chance. ReAct/ablations means all of that folder. "
            "Other options replace single settings."
        ),
    ] = ""
    pack: Annotated[
        Path | None,
        typer.Option(
            "--pack",
            help="Folder of a pack, or a built-in one: ours, shifts, or paper (instances drawn as "
            "in the paper). Default: the built-in pack with the data sets or tasks.",
        ),
    ] = None
    datasets: Annotated[
        str,
        typer.Option(help="Data sets. Default: all of the pack. `shifts` are a pack of their own."),
    ] = ""
    tasks: Annotated[str, typer.Option(help="Tasks. Default: all.")] = ""
    kinds: Annotated[
        str,
        typer.Option(
            help="Kinds of instances: default, free, noisy. Default: free, if the pack has any."
        ),
    ] = ""
    instances: Annotated[
        str,
        typer.Option(help="Seeds or ids of instances, such as 42,84. Default: all of the kinds."),
    ] = ""
    limit: Annotated[
        int | None, typer.Option(min=1, help="Most instances of each task. Default: all.")
    ] = None
    seats: Annotated[
        int | None,
        typer.Option(
            min=1, help="Players of each team for tasks that allow several. Default: as usual."
        ),
    ] = None
    seeds: Annotated[int, typer.Option(min=1, help="Episodes of each agent per instance.")] = 1
    budget: Annotated[
        Literal["own", "published"] | None,
        typer.Option(
            help="Step budget: 1.5 x the optimum (own), or the published constants. Instances "
            "without one are left out. A shift has its own length."
        ),
    ] = None
    variant: Annotated[
        Literal["none", "stochastic", "stochastic-paper", "delay-free"] | None,
        typer.Option(
            help="A cut item reverts with the probability of the published code (stochastic, 0.1 "
            "per step) or of the paper (stochastic-paper, 0.33), or nothing takes time. Default: "
            "none, or that of --experiment."
        ),
    ] = None
    control: Annotated[
        Literal["each", "turns", "joint"],
        typer.Option(
            help="Teams: a model for each robot (each), or one model that is asked for one robot "
            "after the other (turns) or for all at once (joint)."
        ),
    ] = "each"
    clock: Annotated[
        Literal["turns", "realtime"],
        typer.Option(help="The world waits for its players (turns), or goes on while they think."),
    ] = "turns"
    step_rate: Annotated[
        float, typer.Option(min=0.01, max=60, help="Real time: steps per second.")
    ] = 5.0
    charge: Annotated[
        str,
        typer.Option(
            help="Real time: cost of a thought. `tokens:20`: 20 ms for each generated token. "
            "`declared:1500`: 1,500 ms for each call."
        ),
    ] = "tokens:20"
    late: LateOption = "apply"
    max_age: MaxAgeOption = None
    helper: Annotated[
        Literal["none", "planner", "script"],
        typer.Option(help="Real time: bot that acts while a model thinks."),
    ] = "none"
    digest_tokens: DigestTokensOption = 0
    slack: Annotated[
        float, typer.Option(min=1, max=1000, help="Real time: factor of the step budgets.")
    ] = 1.0
    steps_to_go: Annotated[
        bool,
        typer.Option("--steps-to-go", help="Search how far failed episodes were from the goal."),
    ] = False
