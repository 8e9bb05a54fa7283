"""Forms with fields for a server and a code: Enter, what is typed, what is kept."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.evening import Evening
from tests.support.window_play import follow, post

from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.hands.commands import Command
from robotouille_client.window.shell.screens.server_menus import JoinMenu, OpenMenu
from robotouille_client.window.shell.settings import Settings


def test_enter_in_any_field_leads_to_the_main_button(display: Display) -> None:
    for form, main in ((JoinMenu(Settings()).form, "Play"), (OpenMenu(Settings()).form, "Open")):
        for field in [row for row in form.rows if isinstance(row, TextField)]:
            form.focus(field)
            form.command(Command.ENTER)
            assert form.focused is not None
            assert form.focused.label.startswith(main)
            assert form.result is None


def test_the_code_is_replaced_by_what_is_typed_and_edited_after_a_second_click(
    display: Display,
) -> None:
    form = JoinMenu(Settings(code="ABC")).form
    code = form.focused
    assert isinstance(code, TextField)
    post("x")
    follow(form)
    assert code.text == "x"
    form.command(Command.DOWN)
    form.command(Command.UP)
    assert code.selected
    code.click(0.5)
    post("y")
    follow(form)
    assert code.text == "xy"
    code.click(0.5)
    assert code.selected


def test_an_error_goes_when_another_address_is_typed(display: Display) -> None:
    for form in (JoinMenu(Settings(), "Nobody.").form, OpenMenu(Settings(), "Nobody.").form):
        server = next(row for row in form.rows if row.label == "Server")
        form.focus(server)
        assert form.message == "Nobody."
        server.letters("0")
        assert form.message == ""


def test_letters_that_are_typed_on_a_button_go_to_the_last_field(display: Display) -> None:
    form = OpenMenu(Settings(server="ws://a")).form
    server = next(row for row in form.rows if row.label == "Server")
    assert isinstance(server, TextField)
    form.focus(server)
    form.command(Command.DOWN)
    assert form.focused is not None
    assert form.focused.label == "Back"
    post("e", "s")
    follow(form)
    assert form.result is None
    assert (server.text, form.focused) == ("ws://aes", server)


@pytest.mark.parametrize("menu", [JoinMenu, OpenMenu])
async def test_what_was_typed_is_kept_when_one_goes_back(
    display: Display, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, menu: type
) -> None:
    evening = Evening(tmp_path)
    evening.watch(monkeypatch)

    def script() -> Iterator[None]:
        yield
        label = "Join by code" if menu is JoinMenu else "Open a kitchen on a server"
        yield from evening.choose(label)
        assert evening.form is not None
        server = next(row for row in evening.form.rows if row.label == "Server")
        evening.form.focus(server)
        server.letters("0")
        yield from evening.choose("Back")
        assert evening.form.focused is not None
        assert evening.form.focused.label == label, "the menu comes back where one was"
        yield from evening.choose("Quit")

    await evening.go(script)
    assert evening.shell.ui.preferences.server == "ws://127.0.0.1:87650"
