"""The options of `robotouille-bot llm`: which model plays, how it is asked, and its seats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from robotouille_client.console import finite

__all__ = [
    "Attempts",
    "BaseUrl",
    "Charge",
    "Control",
    "DigestTokens",
    "Helper",
    "Late",
    "Model",
    "Price",
    "Seats",
    "Strategy",
    "Temperature",
    "Timeout",
    "Transcript",
]

Seats = Annotated[
    str | None,
    typer.Option(help="llm: several seats for one model: all that are free, or robot1,robot2."),
]
Control = Annotated[
    Literal["turns", "joint"] | None,
    typer.Option(
        help="llm with several seats: asked for one after the other (turns, if left out), or "
        "for all at once."
    ),
]
Model = Annotated[
    str, typer.Option(help="llm: the model's name; `local` for a small one, `mock` for none.")
]
BaseUrl = Annotated[
    str, typer.Option(help="llm: an OpenAI-compatible endpoint; OpenAI's if left out.")
]
Strategy = Annotated[str, typer.Option(help="llm: how it is asked (docs/benchmark.md).")]
Temperature = Annotated[
    float | None, typer.Option(min=0, callback=finite, help="llm: sent with each request.")
]
Price = Annotated[
    str, typer.Option(help="llm: of a million tokens sent and received, e.g. 0.40/1.20.")
]
Timeout = Annotated[
    float | None,
    typer.Option(min=0.1, callback=finite, help="llm: seconds for an attempt; 120 if left out."),
]
Attempts = Annotated[
    int | None, typer.Option(min=1, help="llm: how often it is asked at most; 6 if left out.")
]
Transcript = Annotated[
    Path | None, typer.Option(help="llm: a file for what the model is sent and says.")
]
Late = Annotated[
    Literal["apply", "revalidate", "drop"],
    typer.Option(help="llm in real time: what becomes of late answers (docs/benchmark.md)."),
]
Helper = Annotated[
    Literal["none", "planner"],
    typer.Option(help="llm in real time: who acts while the model thinks."),
]
DigestTokens = Annotated[
    int,
    typer.Option(min=0, help="llm in real time: the longest digest of what has changed; 0: none."),
]
Charge = Annotated[
    str,
    typer.Option(
        help="llm, where thinking is declared: what it costs. `wall`, `tokens:20` for 20 ms a "
        "token, `declared:1500` for 1,500 ms a call."
    ),
]
