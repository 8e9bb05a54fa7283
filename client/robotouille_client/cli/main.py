"""The command `robotouille`, whose subcommands are imported when they are used."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.terminal import printable, tell
from robotouille_client.console import JsonOption, VersionOption, explain, fail


@dataclass(frozen=True, slots=True)
class LazyCommand:
    """A command that is not imported yet.

    Attributes:
        place: `module:name` of a function or a Typer application.
        help: The first paragraph of its help.
    """

    place: str
    help: str

    def load(self, called: str) -> Any:
        """Import and return the command."""
        module, _, name = self.place.partition(":")
        found = getattr(import_module(module), name)
        app = found if isinstance(found, typer.Typer) else typer.Typer(add_completion=False)
        if app is not found:
            app.command()(found)
        command = typer.main.get_command(app)
        command.name = called
        return command


class LazyGroup(TyperGroup):
    """Command group that lists the commands in `lazy` without importing them.

    Importing all of them would take seconds, and `--help` needs their first lines only.
    """

    lazy: ClassVar[Mapping[str, LazyCommand]] = {}

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        listed = {name: TyperCommand(name, help=c.help) for name, c in self.lazy.items()}
        self.commands = {**listed, **self.commands}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        self.load(args[0])
        return super().resolve_command(ctx, args)

    def load(self, *names: str) -> None:
        """Import the named commands, or all of them."""
        for name in names or self.lazy:
            if name in self.lazy:
                self.commands[name] = self.lazy[name].load(name)


class _Commands(LazyGroup):
    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise  # The reader of the output has gone, which ends the command silently.
        except OSError as error:  # A path that is too long, for example.
            fail(explain(error))

    lazy: ClassVar = {
        "play": LazyCommand(
            "robotouille_client.cli.play:play",
            "Play a task in a window, without a server. Bots play the other seats.",
        ),
        "pddl": LazyCommand(
            "robotouille_client.cli.plan:pddl",
            "Write a task in PDDL for other planners.",
        ),
        "plan": LazyCommand(
            "robotouille_client.cli.plan:plan",
            "Find the shortest plan of a task, and prove that no plan is shorter.",
        ),
        "certify": LazyCommand(
            "robotouille_client.cli.certify:certify",
            "Certify the shortest plans of all problems in a folder, and write a manifest of them.",
        ),
        "generate": LazyCommand(
            "robotouille_client.cli.generate:generate",
            "Make new instances of a task from a seed, and prove that each can be solved.",
        ),
        "episodes": LazyCommand(
            "robotouille_client.cli.episodes:episodes",
            "Open, list and close the episodes of a study on a server, from and to CSV.",
        ),
        "replay": LazyCommand(
            "robotouille_client.cli.replay:replay",
            "Show, verify, measure, watch and export recordings.",
        ),
        "data": LazyCommand(
            "robotouille_data.cli:data",
            "Index recordings in a catalogue, query it, and export from it.",
        ),
        "benchmark": LazyCommand(
            "robotouille_evaluation.cli.benchmark:benchmark",
            "Evaluate agents on packs of tasks: run, resume, measure, report, compare.",
        ),
        "cross-play": LazyCommand(
            "robotouille_evaluation.cli.cross_play:cross_play",
            "Let all pairs of partners play a task, and print the means with 95 % intervals.",
        ),
        "pack": LazyCommand(
            "robotouille_evaluation.cli.pack:pack",
            "Import, build, check, prove and compare packs of tasks for the benchmark.",
        ),
    }


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    add_completion=False,
    help="Robotouille kitchens: tasks, linting, local play and recordings.",
)


@app.callback()
def _options(version: VersionOption = False) -> None: ...


@app.command()
def tasks(
    json_output: JsonOption = False,
) -> None:
    """List the shipped tasks with their seats and goals."""
    from robotouille import load_task, task_names

    rows: list[dict[str, Any]] = []
    for name in task_names():
        task = load_task(name)
        counts = list(task.problem.seats or (task.seats,))
        rows.append({"task": name, "seats": counts, "goal": task.goal_description})
    if json_output:
        typer.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        seats = ", ".join(map(str, row["seats"]))
        tell(f"{row['task']}  (seats: {seats})\n    {row['goal']}")


@app.command()
def lint(
    files: Annotated[list[str], typer.Argument(help="Problem or domain files, or task names.")],
    domain: Annotated[
        str | None, typer.Option(help="Domain file for problems that do not name one.")
    ] = None,
    json_output: JsonOption = False,
) -> None:
    """Report all faults of domains, problems, renderings and input files.

    The exit status is 1 if there is an error.
    """
    found = {name: lint_file(name, domain) for name in files}
    errors = sum(f.severity == "error" for faults in found.values() for f in faults)
    if json_output:
        rows = [
            {"file": name, "path": f.path, "severity": f.severity, "message": f.message}
            for name, faults in found.items()
            for f in faults
        ]
        typer.echo(json.dumps(rows, indent=2))
    else:
        reported: set[Fault] = set()
        for name, faults in found.items():
            # Notes on a domain would come again for each of its problems.
            shown = [f for f in faults if f.severity != "note" or f not in reported]
            for fault in shown:
                tell(printable(f"{name}: {fault.severity}: {fault}"))
            reported.update(faults)
            if not faults:
                tell(f"{printable(name)}: no faults")
            elif not shown:
                tell(f"{printable(name)}: no other faults")
    if errors:
        raise typer.Exit(1)


def lint_file(name: str, domain: str | None = None) -> list[Fault]:
    """Return all faults of a task, domain, rendering or input file."""
    from robotouille import load_task
    from robotouille.domain.json_files import read_json
    from robotouille.domain.rendering import RenderingFile
    from robotouille.world.lint import (
        faults_for,
        lint_domain_file,
        lint_problem_file,
        lint_task,
    )

    try:
        raw = read_json(Path(name)) if name.endswith(".json") else {}
        keys = set(raw) if isinstance(raw, dict) else set()
        if "name" in keys or "action_defs" in keys:
            return lint_domain_file(Path(name))
        if name.endswith(".input.json") or keys & {"keyboard_actions", "mouse_click_actions"}:
            return _lint_input(Path(name), domain)
        if keys & set(RenderingFile.model_fields) and not keys & {"goal", "width"}:
            return _lint_rendering(Path(name))
        if name.endswith(".json"):
            return lint_problem_file(Path(name), domain)
        return lint_task(load_task(name, domain=domain))
    except FileError as error:
        return faults_for(Path(name), error)
    except RobotouilleError as error:
        return [Fault("", str(error))]


def _lint_input(path: Path, domain: str | None) -> list[Fault]:
    from robotouille.domain.input_bindings import INPUT_FILES
    from robotouille.domain.related_files import read_extending
    from robotouille.domain.task import read_domain
    from robotouille.world.lint import lint_input

    own = path.with_name(path.name.replace(".input.json", ".json"))
    domain_file = str(own) if own.is_file() and own != path else "robotouille"
    inputs = read_extending(path, INPUT_FILES)
    return lint_input(inputs, read_domain(domain or domain_file), path.name)


def _lint_rendering(path: Path) -> list[Fault]:
    from robotouille.domain.task import read_domain
    from robotouille.world.lint_renderings import lint_rendering

    own = path.with_name(path.name.replace(".rendering.json", ".json"))
    domain = read_domain(str(own)) if own != path and own.is_file() else None
    return lint_rendering(path, domain, path.parent)


@app.command()
def text(
    task: Annotated[str, typer.Argument(help="Task name or problem file.")],
    player: Annotated[
        str | None, typer.Option(help="Player whose valid actions are listed.")
    ] = None,
) -> None:
    """Print the first observation of a task in words."""
    from pydantic import ValidationError

    from robotouille import World, load_task
    from robotouille.world.lint import sound_task

    try:
        tell(World(sound_task(load_task(task))).initial.text(player))
    except (RobotouilleError, ValidationError, KeyError) as error:
        fail(explain(error))


def main() -> None:
    """Run `robotouille`."""
    app()


if __name__ == "__main__":
    main()
