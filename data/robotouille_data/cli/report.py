"""`robotouille data report`: one page that compares episodes by a label."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robotouille.program import printable, tell
from robotouille_client.console import name_and_value
from robotouille_client.console.progress import progress_bar
from robotouille_data.cli.console import DatabaseOption, FolderOption, catalogue, errors_told

__all__ = ["report"]


def report(
    query: Annotated[
        str | None,
        typer.Argument(help="SQL with a column `id` or `episode_id`; all episodes if not given."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The page.")] = Path("report.html"),
    database: DatabaseOption = None,
    folder: FolderOption = Path(),
    label: Annotated[
        list[str] | None,
        typer.Option("--label", metavar="NAME=VALUE", help="Only episodes that have it."),
    ] = None,
    by: Annotated[str, typer.Option("--by", help="The label that is compared.")] = "condition",
    text: Annotated[
        bool, typer.Option("--text/--no-text", help="Also what was said in the chat.")
    ] = True,
    title: Annotated[
        str, typer.Option("--title", help="The page's.")
    ] = "Robotouille: a first look",
    seconds: Annotated[float, typer.Option(min=0.001, help="How long it may take.")] = 60.0,
) -> None:
    """Compare episodes by a label, on one HTML page: outcomes, what seats did, time lines, chat.

    The page needs nothing beside it and asks nobody for anything.
    """
    with errors_told():
        from robotouille_data.answers.report.write import write_report

        labels = dict(name_and_value(each, "--label") for each in label or ())
        url = catalogue(database, folder)
        with progress_bar("report") as progress:
            count = write_report(
                url, out, query=query, labels=labels, by=by, text=text, title=title,
                seconds=seconds, progress=progress.stage,
            )  # fmt: skip
    tell(printable(f"{out}: {count} episode{'s' * (count != 1)}"))
