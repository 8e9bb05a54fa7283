"""The options of `robotouille benchmark run`; `resume` has some of them, too."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

__all__ = [
    "Agents",
    "Attempts",
    "BaseUrl",
    "Budget",
    "Calls",
    "Charge",
    "Clock",
    "Control",
    "Datasets",
    "DigestTokens",
    "Helper",
    "Kinds",
    "Late",
    "Model",
    "Out",
    "Pack",
    "Price",
    "Processes",
    "Scheduler",
    "Seats",
    "Seeds",
    "Slack",
    "StepRate",
    "StepsToGo",
    "Tasks",
    "Temperature",
    "Timeout",
    "Variant",
]

# What is played

Out = Annotated[Path, typer.Argument(help="A new folder for the run.")]
Agents = Annotated[
    str,
    typer.Option(
        "--agents",
        help="Who plays: planner, random, scripted, or strategies of a language model "
        "(react-last-reasoning-action, io, …, or an experiment of the pack).",
    ),
]
Pack = Annotated[
    Path | None,
    typer.Option("--pack", help="A pack's folder (`robotouille pack build`); ours if none."),
]
Datasets = Annotated[str, typer.Option(help="Which data sets; all if none are named.")]
Tasks = Annotated[str, typer.Option(help="Which tasks; all if none are named.")]
Kinds = Annotated[str, typer.Option(help="default, free, noisy.")]
Seats = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Players of each team, where tasks leave it open; the usual number if left out.",
    ),
]
Seeds = Annotated[int, typer.Option(min=1, help="How often each agent plays.")]
Budget = Annotated[
    Literal["own", "published"] | None,
    typer.Option(help="The limit of steps: 1.5 x the optimum, or the published constants."),
]
Variant = Annotated[
    Literal["stochastic", "delay-free"] | None,
    typer.Option(help="A cut item reverts by chance; or nothing has to be waited for."),
]
Control = Annotated[
    Literal["each", "turns", "joint"],
    typer.Option(
        help="Teams: one model for each robot; or one for all, asked for one robot after the "
        "other, or for all at once."
    ),
]
StepsToGo = Annotated[
    bool,
    typer.Option("--steps-to-go", help="Measure how far failed episodes were from the goal."),
]

# Real time

Clock = Annotated[
    Literal["turns", "realtime"],
    typer.Option(help="Whether the world waits for its players, or goes on while they think."),
]
StepRate = Annotated[float, typer.Option(min=0.01, max=60, help="Real time: steps a second.")]
Charge = Annotated[
    str,
    typer.Option(
        help="Real time: what a thought costs. `tokens:20` are 20 ms a generated token, "
        "`declared:1500` 1,500 ms a call."
    ),
]
Late = Annotated[
    Literal["apply", "revalidate", "drop"],
    typer.Option(help="Real time: what becomes of late answers (docs/benchmark.md)."),
]
Helper = Annotated[
    Literal["none", "planner", "script"],
    typer.Option(help="Real time: who acts while a model thinks."),
]
DigestTokens = Annotated[
    int,
    typer.Option(min=0, help="Real time: the longest digest of what has changed; 0: none."),
]
Slack = Annotated[
    float,
    typer.Option(min=1, max=1000, help="Real time: by how much limits of steps are multiplied."),
]

# Language models

Model = Annotated[
    str,
    typer.Option(
        help="The language model's name; `local` for a small one, `mock` for none, "
        "`inspect:PROVIDER/NAME` by a provider of Inspect."
    ),
]
BaseUrl = Annotated[str, typer.Option(help="Of an OpenAI-compatible endpoint.")]
Temperature = Annotated[float | None, typer.Option(help="Sent with each request.")]
Price = Annotated[str, typer.Option(help="Of a million tokens sent and received, e.g. 0.40/1.20.")]
Timeout = Annotated[
    float | None,
    typer.Option(min=0.1, help="Seconds for one attempt to ask a model; 120 if left out."),
]
Attempts = Annotated[
    int | None,
    typer.Option(min=1, help="How often a model is asked one thing at most; 6 if left out."),
]

# What a run may use

Processes = Annotated[
    int, typer.Option("--processes", min=1, help="Processes for agents that plan.")
]
Calls = Annotated[
    int, typer.Option("--calls", min=1, help="Episodes that wait for a model at the same time.")
]
Scheduler = Annotated[
    str, typer.Option("--scheduler", help="A Dask scheduler's address, instead of processes.")
]
