"""Texts from other people (names, chat, errors, files) cannot control the terminal."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from robotouille.errors import Fault, FileError, ProtocolError
from robotouille.terminal import printable, printable_json, tell
from robotouille_client.bots import cli as bots
from robotouille_client.bots import seat_session
from robotouille_client.console import explain, fail
from robotouille_client.errors import ConnectionFailedError
from tests.support.sources import MODULES, parsed

HOSTILE = "a\x1b]0;owned\x07b\x9b31mc\u202ed\u2066e\u2028f\rg\x00h"
RAW = set(HOSTILE) - set("abcdefgh") - set("]0;owned31m")


def is_safe(call: ast.Call) -> bool:
    """Return whether a printing call prints JSON or a constant."""
    if not call.args:
        return True
    (first, *_) = call.args
    safe = ("json.dumps(", "printable_json(", "RELEASE")
    return ast.unparse(first).startswith(safe)


def prints(path: Path) -> list[str]:
    """Return the calls of a module that print other texts."""
    found = []
    for node in ast.walk(parsed(path)):
        if not isinstance(node, ast.Call):
            continue
        words = ast.unparse(node.func)
        if words in ("print", "typer.echo", "sys.stdout.write", "sys.stderr.write"):
            found += [] if is_safe(node) else [f"{path.name}:{node.lineno}: {ast.unparse(node)}"]
    return found


@pytest.mark.slow
def test_only_tell_prints_text_that_is_not_json() -> None:
    found = [line for path in MODULES if path.name != "terminal.py" for line in prints(path)]
    assert not [line for line in found if "worker" not in line.partition(":")[0]]


def test_tell_removes_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    tell(f"one {HOSTILE}\ntwo", err=True)
    shown = capsys.readouterr().err
    assert not RAW.intersection(shown)
    assert shown.endswith("h\ntwo\n")
    assert printable("Zoë 愛 🍅") == "Zoë 愛 🍅"


def test_printable_json_keeps_its_value() -> None:
    row = {"name": HOSTILE, "plain": "Zoë"}
    shown = printable_json(json.dumps(row, ensure_ascii=False, indent=1))
    assert json.loads(shown) == row
    assert "Zoë" in shown
    assert not RAW.intersection(shown)


@pytest.mark.parametrize(
    "error",
    [
        ProtocolError("seat/taken", f"robot1 is played by {HOSTILE}\nnot a line of ours"),
        ConnectionFailedError(f"ws://x: {HOSTILE}\nnot a line of ours"),
        KeyError(f"{HOSTILE}\nnot a line of ours"),
    ],
)
def test_server_error_is_one_line(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit):
        fail(explain(error))
    shown = capsys.readouterr().err
    assert not RAW.intersection(shown)
    assert shown.count("\n") == 1


def test_faults_of_a_file_have_one_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    error = FileError("a.json", [Fault("x", HOSTILE), Fault("y", "wrong")])
    with pytest.raises(typer.Exit):
        fail(explain(error))
    shown = capsys.readouterr().err
    assert not RAW.intersection(shown)
    assert shown.endswith("a.json: y: wrong\n")
    assert shown.count("\n") == 2


def test_bot_prints_server_texts_without_control_characters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def run(*_: object) -> dict[str, object]:
        tell(f"{HOSTILE} plays {HOSTILE}", err=True)
        return {"reason": HOSTILE, "steps": HOSTILE}

    monkeypatch.setattr(seat_session, "play_seat", run)
    app = typer.Typer()
    app.command()(bots.command)
    result = CliRunner().invoke(app, ["random", "--episode", "x"])
    assert result.exit_code == 0
    assert "after" in result.output
    assert not RAW.intersection(result.output)
