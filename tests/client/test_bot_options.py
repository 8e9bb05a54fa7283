"""Options of `robotouille-bot` that do not go together."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from robotouille_client.bots.cli import command


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["planner", "--seats", "all"], "only a language model (llm) plays several --seats"),
        (["planner", "--seats", "all"], "start a bot for each seat, with --seat"),
        (["llm", "--seats", "all", "--seat", "robot1"], "not both"),
        (["llm", "--control", "joint"], "--control is for one model in several --seats"),
    ],
)
def test_options_that_do_not_go_together(words: list[str], told: str) -> None:
    app = typer.Typer()
    app.command()(command)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    assert told in " ".join(done.stderr.split())
