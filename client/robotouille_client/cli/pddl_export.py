"""`robotouille pddl TASK`: write a task for other planners."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from robotouille.errors import RobotouilleError
from robotouille.planning.pddl import EncodingStyle
from robotouille_client.console import explain, fail

__all__ = ["pddl"]


def pddl(
    task: Annotated[str, typer.Argument(help="Task name or problem file.")],
    out: Annotated[Path, typer.Option(help="Folder for domain.pddl and problem.pddl.")],
    encoding: Annotated[
        EncodingStyle, typer.Option(help="steps: exact; durative: PDDL 2.1, without pauses.")
    ] = EncodingStyle.STEPS,
    seats: Annotated[int | None, typer.Option(help="Number of seats.")] = None,
    created: Annotated[
        int | None, typer.Option(min=1, help="Objects of a kind that can be created.")
    ] = None,
) -> None:
    """Write a task in PDDL, for planners of other people."""
    from robotouille import World, load_task
    from robotouille.planning.pddl import encode

    try:
        if out.exists() and not out.is_dir():
            raise RobotouilleError(f"--out: {out} is a file; expected a folder")
        written = encode(World(load_task(task, seats=seats)), encoding, created=created)
        out.mkdir(parents=True, exist_ok=True)
        (out / "domain.pddl").write_text(written.domain, encoding="utf-8")
        (out / "problem.pddl").write_text(written.problem, encoding="utf-8")
    except (RobotouilleError, ValidationError, KeyError, OSError) as error:
        fail(explain(error))
