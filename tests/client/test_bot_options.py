"""Conflicting options of `robotouille-bot`."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from robotouille_client.bots.cli import command


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["planner", "--seats", "all"], "only a language model (llm) plays several --seats"),
        (["planner", "--seats", "all"], "start one bot with --seat for each seat"),
        (["llm", "--seats", "all", "--seat", "robot1"], "not both"),
        (["llm", "--control", "joint"], "--control needs --seats"),
    ],
)
def test_conflicting_bot_options_are_rejected(words: list[str], told: str) -> None:
    app = typer.Typer()
    app.command()(command)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    assert told in " ".join(done.stderr.split())
