"""Options of language models, for `robotouille-bot llm` and `robotouille benchmark run`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from robotouille_client.console import finite

TimeoutOption = Annotated[
    float | None,
    typer.Option(
        min=0.1, callback=finite, help="Seconds for one attempt at a model call. Default: 120."
    ),
]
AttemptsOption = Annotated[
    int | None, typer.Option(min=1, help="Maximum number of attempts at a model call. Default: 6.")
]
LateOption = Annotated[
    Literal["apply", "revalidate", "drop"],
    typer.Option(
        help="Language models in real time: handling of late answers (docs/evaluate_models.md)."
    ),
]
MaxAgeOption = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=1_000_000,
        help="Language models in real time: drop answers to observations that are more steps old "
        "than this.",
    ),
]
DigestTokensOption = Annotated[
    int,
    typer.Option(
        min=0,
        help="Language models in real time: maximum length of the digest of changes. 0: no digest.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """The choice of a language model and how it is called."""

    model: Annotated[
        str,
        typer.Option(
            help="Name of the language model. `local`: a small model in this process. `mock`: "
            "seeded answers without a model. `inspect:PROVIDER/NAME`: a provider of Inspect."
        ),
    ] = "mock"
    base_url: Annotated[
        str,
        typer.Option(help="OpenAI-compatible endpoint of the language model. Default: OpenAI's."),
    ] = ""
    temperature: Annotated[
        float | None,
        typer.Option(min=0, callback=finite, help="Temperature that each model call asks for."),
    ] = None
    price: Annotated[
        str,
        typer.Option(
            help="Price of a million tokens sent to and received from the language model, "
            "such as 0.40/1.20."
        ),
    ] = ""
    timeout: TimeoutOption = None
    attempts: AttemptsOption = None


@dataclass(frozen=True, kw_only=True)
class LlmBotOptions(ModelOptions):
    """The options of a language model that plays on a server."""

    strategy: Annotated[
        str,
        typer.Option(
            help="Strategy of the language model (docs/evaluate_models.md). Default: "
            "react-last-reasoning-action-plan, or react-last-reasoning-action with --control joint."
        ),
    ] = ""
    pack: Annotated[
        str,
        typer.Option(
            help="Pack with the prompts, examples and experiments of the strategies: ours, or the "
            "folder of a pack (docs/packs.md)."
        ),
    ] = "ours"
    transcript: Annotated[
        Path | None, typer.Option(help="File for the transcript of all model calls.")
    ] = None
    seats: Annotated[
        str | None,
        typer.Option(
            help="Seats for one language model: `all` free ones, or names such as robot1,robot2."
        ),
    ] = None
    control: Annotated[
        Literal["turns", "joint"] | None,
        typer.Option(
            help="With --seats: one model call for each player (turns, the default), or one for "
            "all players (joint)."
        ),
    ] = None
    late: LateOption = "apply"
    max_age: MaxAgeOption = None
    helper: Annotated[
        Literal["none", "planner"],
        typer.Option(help="Language models in real time: bot that acts while the model thinks."),
    ] = "none"
    digest_tokens: DigestTokensOption = 0
    charge: Annotated[
        str,
        typer.Option(
            help="Cost of a model call in episodes with declared thinking time. `wall`: its "
            "duration. `tokens:20`: 20 ms for each generated token. `declared:1500`: 1,500 ms."
        ),
    ] = "wall"
