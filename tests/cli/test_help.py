"""`--help` is fast: each command imports its own modules."""

from __future__ import annotations

import subprocess
import sys

import pytest
import typer
from typer.core import TyperGroup
from typer.testing import CliRunner

from robotouille_client.cli.main import LazyGroup, app

HEAVY = [
    "asyncio",
    "av",
    "matplotlib",
    "mcp",
    "msgpack",
    "numba",
    "numpy",
    "pydantic",
    "pygame",
    "robotouille.episode.episode",
    "robotouille.planning",
    "robotouille.protocol",
    "robotouille.world",
    "websockets",
]
PROGRAMS = {
    "robotouille": "robotouille_client.cli.main",
    "robotouille-bot": "robotouille_client.bots.cli",
    "robotouille-client": "robotouille_client.window.cli",
    "robotouille-loadtest": "robotouille_client.loadtest.cli",
    "robotouille-mcp": "robotouille_client.mcp_server.cli",
}


@pytest.mark.process
@pytest.mark.parametrize("program", PROGRAMS)
def test_help_imports_no_heavy_module(program: str) -> None:
    source = (
        f"import sys; sys.argv = [{program!r}, '--help']\n"
        f"from {PROGRAMS[program]} import main\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        f"print('imported:', *[m for m in {HEAVY!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Usage" in done.stdout
    assert done.stdout.splitlines()[-1].split() == ["imported:"]


def test_listed_help_matches_the_commands() -> None:
    group = typer.main.get_command(app)
    assert isinstance(group, LazyGroup)
    listed = {name: command.help for name, command in group.commands.items()}
    group.load()
    for name, command in group.commands.items():
        line = " ".join((command.help or "").partition("\n\n")[0].split())
        assert line == " ".join((listed[name] or "").partition("\n\n")[0].split())
        assert command.name == name
    assert isinstance(group.commands["replay"], TyperGroup)


def test_unknown_command_suggests_a_similar_one() -> None:
    result = CliRunner().invoke(app, ["plam"])
    assert result.exit_code == 2
    assert "plan" in result.output
