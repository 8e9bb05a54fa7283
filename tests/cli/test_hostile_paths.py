"""Paths with control characters, line feeds or invalid UTF-8 cannot break errors about them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperArgument
from typer.testing import CliRunner

from robotouille_client.cli.main import LazyGroup, app
from tests.support.samples import quick_sample

HOSTILE = {
    "line feed": "no/file\nforged: line\rforged: return",
    "escape": "no/\x1b]0;owned\x07\x9b31m\u202e",
    "not UTF-8": "no/\udcff",
    "long": "no/" + 5000 * "x",
    "long component": 40 * "no/" + 300 * "x" + ".json",
    "dash": "-no/-x",
    "JSON": "no/\x1b[2J\nforged: line.json",
}
TASKS = {"task", "dataset", "files", "table", "domain", "partners"}
"""Parameters that take a path or something else."""
OTHERWISE = {
    "benchmark run": ["--tasks=nonsense"],
    "pack build": ["nonsense"],
}
"""Further words for commands that could do without the path."""


def commands(command: Any, *words: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield all commands with their words."""
    if isinstance(command, LazyGroup):
        command.load()
    if not hasattr(command, "commands"):
        yield words, command
        return
    for name, each in command.commands.items():
        yield from commands(each, *words, name)


def takes_path(parameter: Any) -> bool:
    return parameter.name in TASKS or "Path" in str(parameter.type_descriptor.annotation)


def calls() -> Iterator[tuple[str, list[str]]]:
    """Yield for each parameter with a path its name, and the words that call its command."""
    for words, command in commands(typer.main.get_command(app)):
        own = [each for each in command.params if hasattr(each, "type_descriptor")]
        name = " ".join(words)
        for tested in filter(takes_path, own):
            options, arguments = [*OTHERWISE.get(name, ())], []
            for each in own:
                if each is tested or each.required:
                    value = "{}" if each is tested else "x"
                    if isinstance(each, TyperArgument):
                        arguments.append(value)
                    else:
                        options.append(f"{each.opts[0]}={value}")
            yield f"{name} {tested.opts[0]}", [*words, *options, "--", *arguments]


CALLS = dict(calls())


del CALLS["data watch folders"]  # It waits for the folder.

PROGRAMS = [
    "robotouille_server.cli --config={}",
    "robotouille_server.cli --tasks={}",
    "robotouille_server.auth.token_cli mint host --keys={}",
    "robotouille_server.auth.token_cli revoke x --keys={}",
    "robotouille_client.window.cli --screenshot={}",
    "robotouille_client.window.cli --tasks={}",
    "robotouille_client.bots.cli --episode=x -- {}",
    "robotouille_client.bots.cli scripted --episode=x --plan={}",
    "robotouille_client.loadtest.cli --json={}",
]


def check(output: str) -> None:
    assert output
    assert all(line.isprintable() for line in output.split("\n")), output
    assert "\nforged" not in output
    assert len(output) < 20_000


@pytest.mark.parametrize("kind", quick_sample(HOSTILE))
@pytest.mark.parametrize("call", CALLS)
def test_hostile_path_is_explained(
    call: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [word.replace("{}", HOSTILE[kind]) for word in CALLS[call]]
    result = CliRunner().invoke(app, words)
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (1, 2), result.output
    check(result.output)
    assert not [*tmp_path.iterdir()]


@pytest.mark.slow
@pytest.mark.parametrize("call", CALLS)
def test_hostile_path_of_a_broken_file_is_explained(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name = HOSTILE["JSON"]
    Path("no").mkdir()
    Path(name).write_bytes(b"garbage")
    result = CliRunner().invoke(app, [word.replace("{}", name) for word in CALLS[call]])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    check(result.output)


@pytest.mark.parametrize("kind", HOSTILE)
@pytest.mark.parametrize("program", PROGRAMS)
def test_hostile_path_of_a_program_is_explained(
    program: str,
    kind: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    # Later tests would log to the captured output of this one, which is closed by then.
    monkeypatch.setattr("robotouille_server.runtime.logs.configure_logs", lambda *_: None)
    module, *words = program.split()
    monkeypatch.setattr(sys, "argv", ["x", *(w.replace("{}", HOSTILE[kind]) for w in words)])
    with pytest.raises(SystemExit) as end:
        import_module(module).main()
    assert end.value.code in (1, 2)
    check("".join(capsys.readouterr()))
    assert not [*tmp_path.iterdir()]
