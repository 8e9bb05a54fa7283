"""The commands of a window and a bot: tokens, codes, and rules of the episode to open."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path

import pytest
import typer
from tests.support.servers import serving
from tests.support.virtual_time import run
from typer.testing import CliRunner

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_client import connect
from robotouille_client.bots import cli as bots
from robotouille_client.window import cli, parse_size
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.shell.games.remote_game import RemoteGame
from robotouille_server import Server
from robotouille_server.auth.roles import Role

runner = CliRunner()
client_app, bot_app = typer.Typer(), typer.Typer()
client_app.command()(cli.command)
bot_app.command()(bots.command)


def typed(monkeypatch: pytest.MonkeyPatch, module: object, *words: str, **env: str) -> dict:  # type: ignore[type-arg]
    """What a command would do with these words: the arguments of its coroutine."""
    found: dict[str, object] = {}

    async def record(*arguments: object, **options: object) -> dict[str, object]:
        found.update(arguments=arguments, **options)
        return {"reason": "goal", "steps": 1}

    monkeypatch.setattr(module, "_run", record)
    app = client_app if module is cli else bot_app
    done = runner.invoke(app, list(words), env=env)
    assert done.exit_code == 0, done.output
    return found


@pytest.mark.parametrize(("module", "first"), [(cli, "--headless"), (bots, "random")])
def test_a_token_comes_from_the_command_line_or_the_environment(
    monkeypatch: pytest.MonkeyPatch, module: object, first: str
) -> None:
    given = typed(monkeypatch, module, first, "--token", "from-the-line")
    assert "from-the-line" in str(given["arguments"])
    given = typed(monkeypatch, module, first, ROBOTOUILLE_TOKEN="from-outside")
    assert "from-outside" in str(given["arguments"])
    given = typed(monkeypatch, module, first, "--token", "mine", ROBOTOUILLE_TOKEN="other")
    assert "mine" in str(given["arguments"])


def test_help_does_not_show_a_token() -> None:
    shown = runner.invoke(client_app, ["--help"], env={"ROBOTOUILLE_TOKEN": "very-secret"})
    assert "ROBOTOUILLE_TOKEN" in shown.output
    assert "very-secret" not in shown.output


@pytest.mark.parametrize(
    "words",
    [["--absence", "pause"], ["--stand-in", "random"], ["--grace", "5"], ["--seats", "2"]],
)
def test_rules_need_an_episode_to_open(words: list[str]) -> None:
    done = runner.invoke(client_app, ["--headless", *words])
    assert done.exit_code == 1
    assert f"{words[0]} is for an episode that you open" in done.output


async def look_in(server: Server, token: str | None, code: str | None, **opening: object) -> None:
    """A window without a screen, until it is closed."""
    asked = cli._opening(opening.pop("create", None), **opening)  # type: ignore[arg-type]
    entry = cli.JoinOptions(server.url, code, asked, None, watch=False, token=token, ready=False)
    shown = cli.Unattended((320, 240), Preferences(), True, 0.5, None, None)
    await cli._run(entry, "ada", shown)


@pytest.mark.parametrize("option", ["nan", "inf", "1e309", "-1"])
def test_a_window_lingers_for_a_number_of_seconds(option: str) -> None:
    done = runner.invoke(client_app, ["ABCDE-FGHJK", "--headless", "--linger", option])
    assert done.exit_code == 2
    assert "--linger" in done.output


@pytest.mark.parametrize(
    "options",
    [
        ["--temperature", "nan"],
        ["--temperature", "-1"],
        ["--timeout", "1e309"],
        ["--timeout", "nan"],
    ],
)
def test_a_model_is_asked_with_numbers(options: list[str]) -> None:
    done = runner.invoke(bot_app, ["llm", *options])
    assert done.exit_code == 2
    assert options[0] in done.output


@pytest.mark.parametrize(
    ("app", "words"),
    [
        (client_app, ["--name", "a\udcff"]),
        (client_app, ["a\udcff"]),
        (bot_app, ["random", "--name", "a\udcff"]),
        (bot_app, ["random", "--episode", "a\udcff"]),
    ],
)
def test_names_and_codes_can_be_sent(app: typer.Typer, words: list[str]) -> None:
    done = runner.invoke(app, words)
    assert done.exit_code == 2
    assert "is no UTF-8" in done.output


@pytest.mark.parametrize("size", ["\u00b2x\u00b2", f"{'9' * 5000}x1", "1280", "1280x", "99x99"])
def test_a_size_is_two_numbers(size: str) -> None:
    with pytest.raises(RobotouilleError, match="a size is"):
        parse_size(size)


def test_whoever_is_out_before_the_end_is_told_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        async def show(entered: RemoteGame, shown: cli.Unattended) -> None:
            entered.client.protocol.fail(
                ProtocolError("message/invalid-field", "waits_for: no list")
            )

        monkeypatch.setattr(cli, "_show", show)
        async with serving(tmp_path) as server:
            with pytest.raises(RobotouilleError, match=r"cannot be read: .*waits_for: no list"):
                await look_in(server, None, None, create="multi_agent/02")

    run(main())


async def until_joined(server: Server, window: asyncio.Task[None]) -> None:
    for _ in range(100):
        await asyncio.sleep(0.1)
        if any(room.members for room in server.lobby.rooms.values()) or window.done():
            return


def test_an_episode_is_opened_with_rules_for_absence(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            rules = {"absence": "bot", "stand_in": "random", "grace": 7.5}
            create = {"create": "multi_agent/02", **rules}
            window = asyncio.create_task(look_in(server, None, None, **create))
            await until_joined(server, window)
            (room,) = server.lobby.rooms.values()
            found = room.episode.rules.model_dump(mode="json")
            assert {key: found[key] for key in rules} == rules
            room.abort("enough")
            await window

    run(main())


@pytest.mark.parametrize("write", [str.lower, str.upper, lambda code: code.replace("-", "")])
def test_a_code_may_be_typed_with_or_without_dash_and_in_any_case(tmp_path: Path, write) -> None:  # type: ignore[no-untyped-def]
    async def main() -> None:
        async with serving(tmp_path) as server:
            from robotouille.protocol.messages import Create

            room = server.lobby.create(Create(task="multi_agent/02"))
            assert len(room.code) == 11
            assert room.code[5] == "-"
            window = asyncio.create_task(look_in(server, None, write(room.code)))
            await until_joined(server, window)
            assert [member.name for member in room.members] == ["ada"]
            room.abort("enough")
            await window

    run(main())


def test_who_finds_no_free_seat_is_told_of_watching(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, connect(server.url, name="bob") as bob:
            made = await bob.create("synchronous/01")
            await bob.join(made.code)
            with pytest.raises(RobotouilleError, match="taken: --watch shows the game"):
                await look_in(server, None, made.code)

    run(main())


def test_a_server_that_asks_for_a_token_gets_it(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, require_token=True) as server:
            token = server.tokens.mint_role(Role.HOST, seconds=60.0, subject="lab-7")
            window = asyncio.create_task(look_in(server, token, None, create="multi_agent/02"))
            await until_joined(server, window)
            (room,) = server.lobby.rooms.values()
            assert [member.participant for member in room.members] == ["lab-7"]
            room.abort("enough")
            await window

    run(main())


def opened(monkeypatch: pytest.MonkeyPatch, *words: str) -> list[tuple[bool, bool]]:
    """How a command opens the window: whether something was asked for, whether with a menu."""
    found: list[tuple[bool, bool]] = []

    class Recorded:
        remote = None

        def __init__(self, *, menu: bool, **options: object) -> None:
            self.menu = menu

        async def run(self, first: Coroutine[object, object, object] | None) -> None:
            found.append((first is not None, self.menu))
            if first is not None:
                first.close()

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr("robotouille_client.window.shell.starting.open_shell", Recorded)
    done = runner.invoke(client_app, list(words))
    assert done.exit_code == 0, done.output
    return found


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ([], False),
        (["--name", "ada"], False),
        (["--size", "800x600"], False),
        (["KQXZB-MHTWA"], True),
        (["--watch"], True),
        (["--create", "synchronous/01"], True),
        (["--port", "9000"], True),
        (["--url", "ws://here"], True),
    ],
)
def test_without_anything_to_join_there_is_a_menu(
    monkeypatch: pytest.MonkeyPatch, words: list[str], asked: bool
) -> None:
    ((was_asked, menu),) = opened(monkeypatch, *words)
    assert (was_asked, menu) == (asked, True)


@pytest.mark.parametrize(
    ("words", "menu"),
    [
        (["KQXZB-MHTWA", "--token", "t"], False),
        (["KQXZB-MHTWA", "--token", "t", "--menu"], True),
        (["KQXZB-MHTWA", "--no-menu"], False),
        (["--create", "synchronous/01", "--token", "t"], True),
        (["--token", "t"], True),
    ],
)
def test_who_has_a_code_and_a_token_gets_no_menu(
    monkeypatch: pytest.MonkeyPatch, words: list[str], menu: bool
) -> None:
    ((_, with_menu),) = opened(monkeypatch, *words)
    assert with_menu is menu


def test_without_a_menu_something_must_be_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    done = runner.invoke(client_app, ["--no-menu"])
    assert done.exit_code == 1
    assert "name a CODE" in done.output
