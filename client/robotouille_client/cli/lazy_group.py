"""A group of commands whose modules are imported when a command is run, not to list it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

__all__ = ["LazyCommand", "LazyGroup"]


@dataclass(frozen=True, slots=True)
class LazyCommand:
    """Where a command is, and the first line of its help; `place` is `module:name` of a function
    or a Typer application."""

    place: str
    help: str

    def load(self, called: str) -> Any:
        """The command itself."""
        module, _, name = self.place.partition(":")
        found = getattr(import_module(module), name)
        app = found if isinstance(found, typer.Typer) else typer.Typer(add_completion=False)
        if app is not found:
            app.command()(found)
        command = typer.main.get_command(app)
        command.name = called
        return command


class LazyGroup(TyperGroup):
    """Lists the commands of `lazy` by their help alone, before those that are registered."""

    lazy: ClassVar[Mapping[str, LazyCommand]] = {}

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        listed = {name: TyperCommand(name, help=c.help) for name, c in self.lazy.items()}
        self.commands = {**listed, **self.commands}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        self.load(args[0])
        return super().resolve_command(ctx, args)

    def load(self, *names: str) -> None:
        """Import these commands, or all of them."""
        for name in names or self.lazy:
            if name in self.lazy:
                self.commands[name] = self.lazy[name].load(name)
