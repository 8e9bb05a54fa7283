"""Names and options of bots."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from robotouille_client.bots.cli import command
from robotouille_client.bots.kinds import given_names
from robotouille_client.console.kept_seat import kept_seat, kept_seat_of

URL, CODE = "ws://127.0.0.1:1", "ABCDE-FGHJK"


def test_given_names_depend_on_seed_and_seat() -> None:
    assert given_names() == given_names(0) == given_names(0, "robot1")
    assert given_names(0)[1] == given_names(1)[0] == given_names(0, "robot2")[0]
    assert given_names(5, "robot3") == given_names(7)
    names = given_names(3)
    assert len({*names}) == len(names) >= 12
    assert set(given_names(10**9)) == set(names)


def test_each_process_gets_the_first_unused_name(tmp_path: Path) -> None:
    names = given_names()
    with kept_seat_of(tmp_path, URL, CODE, names) as (first, one):
        assert one is not None
        one.keep("token", ("robot1",))
        with kept_seat_of(tmp_path, URL, CODE, names) as (second, two):
            assert (first, second) == names[:2]
            assert two is not None
    with kept_seat_of(tmp_path, URL, CODE, names) as (again, kept):
        assert again == first
        assert kept is not None
        assert kept.token == "token"


def test_first_name_is_shared_if_all_are_taken(tmp_path: Path) -> None:
    with kept_seat(tmp_path, URL, CODE, "ada"):
        with kept_seat_of(tmp_path, URL, CODE, ("ada",)) as found:
            assert found == ("ada", None)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["planner", "--seats", "all"], "only a language model (llm) plays several --seats"),
        (["planner", "--seats", "all"], "start one bot with --seat for each seat"),
        (["llm", "--seats", "all", "--seat", "robot1"], "not both"),
        (["llm", "--control", "joint"], "--control needs --seats"),
    ],
)
def test_conflicting_bot_options_are_rejected(words: list[str], expected: str) -> None:
    app = typer.Typer()
    app.command()(command)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    assert expected in " ".join(done.stderr.split())
