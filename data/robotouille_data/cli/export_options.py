"""The options of `robotouille data export`; `card` has those of the card, too."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "FORMATS",
    "Consent",
    "Contact",
    "Description",
    "Formats",
    "Label",
    "License",
    "NoNames",
    "NoText",
    "Out",
    "PerDecision",
    "Query",
    "Seconds",
    "Split",
    "SplitBy",
    "System",
    "Title",
]

FORMATS = ("parquet", "csv", "jsonl", "chat", "minari", "arrays")

Out = Annotated[Path, typer.Argument(help="A new folder.")]
Formats = Annotated[
    list[str] | None,
    typer.Option("--format", help=f"{', '.join(FORMATS)}; several may be given."),
]
Query = Annotated[
    str, typer.Option(help="SQL with a column `id` or `episode_id`: only these episodes.")
]
Label = Annotated[
    list[str] | None, typer.Option(metavar="NAME=VALUE", help="Only with all these labels.")
]
Consent = Annotated[
    str, typer.Option(metavar="NAME=VALUE", help="Only episodes whose label gives consent.")
]
NoNames = Annotated[bool, typer.Option("--no-names", help="Names and pseudonyms become p1, p2, …")]
NoText = Annotated[
    bool, typer.Option("--no-text", help="Leave out what people and models have written.")
]
Split = Annotated[str, typer.Option(metavar="PART=SHARE,…", help="As train=0.8,test=0.2.")]
SplitBy = Annotated[str, typer.Option(help="Episodes with one value of this label stay together.")]
System = Annotated[
    Path | None, typer.Option(help="Chat: a file with what each conversation begins with.")
]
PerDecision = Annotated[
    bool, typer.Option("--per-decision", help="Chat: a conversation for each decision.")
]
Seconds = Annotated[float, typer.Option(min=0.001, help="How long the query may take.")]

# What the card says

Title = Annotated[str, typer.Option(help="What the data set is called.")]
Description = Annotated[str, typer.Option(help="What it is, in a few sentences.")]
License = Annotated[str, typer.Option("--license", help="An identifier of SPDX, as CC-BY-4.0.")]
Contact = Annotated[str, typer.Option(help="Whom one may ask.")]
