"""Option `--version` of every program."""

from __future__ import annotations

import importlib
from importlib.metadata import EntryPoint, entry_points, version

import pytest

PROGRAMS = [
    e for e in entry_points(group="console_scripts") if e.name.partition("-")[0] == "robotouille"
]


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_every_program_prints_its_version(
    program: EntryPoint, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, target = program.name, program.value
    module, _, function = target.partition(":")
    monkeypatch.setattr("sys.argv", [name, "--version"])
    with pytest.raises(SystemExit) as end:
        getattr(importlib.import_module(module), function)()
    assert end.value.code == 0
    assert capsys.readouterr().out == f"robotouille {version('robotouille')}\n"


def test_installed_programs() -> None:
    assert {program.name for program in PROGRAMS} == {
        "robotouille",
        "robotouille-bot",
        "robotouille-client",
        "robotouille-loadtest",
        "robotouille-lsl",
        "robotouille-mcp",
        "robotouille-server",
        "robotouille-token",
    }
