"""Options of the window and bot commands: tokens, codes, and rules of a new episode."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path

import pytest
import typer
from tests.support.servers import serving
from tests.support.virtual_time import run, virtual
from typer.testing import CliRunner

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_client import connect
from robotouille_client.bots import cli as bots
from robotouille_client.window import StartOptions, cli, parse_size
from robotouille_client.window.app.remote_game import RemoteGame
from robotouille_client.window.preferences import Preferences
from robotouille_server import Server
from robotouille_server.auth.roles import Role

runner = CliRunner()
client_app, bot_app = typer.Typer(), typer.Typer()
client_app.command()(cli.command)
bot_app.command()(bots.command)


def typed(monkeypatch: pytest.MonkeyPatch, module: object, *words: str, **env: str) -> dict:
    """Return the arguments of the coroutine that a command line runs."""
    found: dict[str, object] = {}

    async def record(*arguments: object, **options: object) -> dict[str, object]:
        found.update(arguments=arguments, **options)
        return {"reason": "goal", "steps": 1}

    if module is cli:
        monkeypatch.setattr(cli, "run_unattended", record)
    else:
        monkeypatch.setattr("robotouille_client.bots.seat_session.play_seat", record)
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
    [["--absence", "pause"], ["--substitute", "random"], ["--grace", "5"], ["--seats", "2"]],
)
def test_rules_require_create(words: list[str]) -> None:
    done = runner.invoke(client_app, ["--headless", *words])
    assert done.exit_code == 1
    assert f"{words[0]} requires --create" in done.output


@pytest.mark.parametrize(
    ("app", "words", "fault"),
    [
        *((client_app, ["ABCDE", "--headless", "--linger", value], "--linger")
          for value in ("nan", "inf", "1e309", "-1")),
        (bot_app, ["llm", "--temperature", "nan"], "--temperature"),
        (bot_app, ["llm", "--temperature", "-1"], "--temperature"),
        (bot_app, ["llm", "--timeout", "1e309"], "--timeout"),
        (client_app, ["--name", "a\udcff"], "is not valid UTF-8"),
        (client_app, ["a\udcff"], "is not valid UTF-8"),
        (bot_app, ["random", "--name", "a\udcff"], "is not valid UTF-8"),
        (bot_app, ["random", "--episode", "a\udcff"], "is not valid UTF-8"),
    ],
)  # fmt: skip
def test_invalid_options_are_refused(app: typer.Typer, words: list[str], fault: str) -> None:
    done = runner.invoke(app, words)
    assert done.exit_code == 2
    assert fault in done.output


async def look_in(server: Server, token: str | None, code: str | None, **opening: object) -> None:
    """Show an episode in a window without a screen until it closes."""
    create = opening.pop("create", None)
    new = None if create is None else cli.Opening(str(create), opening)
    entry = cli.JoinOptions(server.url, code, new, None, watch=False, token=token, ready=False)
    shown = cli.Unattended((320, 240), Preferences(), True, 0.5, None, None)
    await cli.run_unattended(entry, "ada", shown)


@pytest.mark.parametrize("size", ["\u00b2x\u00b2", f"{'9' * 5000}x1", "1280", "1280x", "99x99"])
def test_an_invalid_size_is_refused(size: str) -> None:
    with pytest.raises(RobotouilleError, match="invalid size"):
        parse_size(size)


@virtual
async def test_a_removed_participant_gets_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def show(entered: RemoteGame, shown: cli.Unattended) -> None:
        entered.client.protocol.fail(ProtocolError("message/invalid-field", "waits_for: no list"))

    monkeypatch.setattr(cli, "_show", show)
    async with serving(tmp_path) as server:
        with pytest.raises(RobotouilleError, match=r"invalid message.*waits_for: no list"):
            await look_in(server, None, None, create="multi_agent/02")


@virtual
async def test_a_window_opens_no_kitchen_whose_players_see_a_part_of_it(tmp_path: Path) -> None:
    async with serving(tmp_path, sight=2) as server:
        with pytest.raises(RobotouilleError, match="the window needs all of it"):
            await look_in(server, None, None, create="multi_agent/02")
        assert not server.lobby.rooms


async def until_joined(server: Server, window: asyncio.Task[None]) -> None:
    for _ in range(100):
        await asyncio.sleep(0.1)
        if any(room.members for room in server.lobby.rooms.values()) or window.done():
            return


@virtual
async def test_create_passes_rules_for_absence(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        rules = {"absence": "bot", "substitute": "random", "grace": 7.5}
        create = {"create": "multi_agent/02", **rules}
        window = asyncio.create_task(look_in(server, None, None, **create))
        await until_joined(server, window)
        (room,) = server.lobby.rooms.values()
        found = room.episode.rules.model_dump(mode="json")
        assert {key: found[key] for key in rules} == rules
        room.abort("enough")
        await window


@pytest.mark.parametrize("write", [str.lower, str.upper, lambda code: code.replace("-", "")])
def test_codes_ignore_case_and_dashes(tmp_path: Path, write) -> None:
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


@virtual
async def test_a_full_episode_suggests_watching(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="bob") as bob:
        made = await bob.create("synchronous/01")
        await bob.join(made.code)
        with pytest.raises(RobotouilleError, match="taken; use --watch"):
            await look_in(server, None, made.code)


@virtual
async def test_the_token_is_sent(tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True) as server:
        token = server.tokens.mint_role(Role.HOST, seconds=60.0, subject="lab-7")
        window = asyncio.create_task(look_in(server, token, None, create="multi_agent/02"))
        await until_joined(server, window)
        (room,) = server.lobby.rooms.values()
        assert [member.participant for member in room.members] == ["lab-7"]
        room.abort("enough")
        await window


def opened(monkeypatch: pytest.MonkeyPatch, *words: str) -> list[tuple[bool, bool]]:
    """Return how a command opens the app."""
    found: list[tuple[bool, bool]] = []

    class Recorded:
        remote = None

        def __init__(self, options: StartOptions) -> None:
            self.menu = options.menu

        async def run(self, first: Coroutine[object, object, object] | None) -> None:
            found.append((first is not None, self.menu))
            if first is not None:
                first.close()

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr("robotouille_client.window.open_app", Recorded)
    done = runner.invoke(client_app, list(words))
    assert done.exit_code == 0, done.output
    return found


@pytest.mark.parametrize(
    ("words", "joins", "menu"),
    [
        ([], False, True),
        (["--name", "ada"], False, True),
        (["--size", "800x600"], False, True),
        (["KQXZB-MHTWA"], True, True),
        (["--watch"], True, True),
        (["--create", "synchronous/01"], True, True),
        (["--port", "9000"], True, True),
        (["--url", "ws://here"], True, True),
        (["KQXZB-MHTWA", "--token", "t"], True, False),
        (["KQXZB-MHTWA", "--token", "t", "--menu"], True, True),
        (["KQXZB-MHTWA", "--no-menu"], True, False),
        (["--create", "synchronous/01", "--token", "t"], True, True),
    ],
)
def test_options_decide_between_the_menu_and_a_game(
    monkeypatch: pytest.MonkeyPatch, words: list[str], joins: bool, menu: bool
) -> None:
    assert opened(monkeypatch, *words) == [(joins, menu)]


@pytest.mark.parametrize("code", ["", " "])
def test_an_empty_code_is_an_error(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    done = runner.invoke(client_app, [code, "--name", "ada"])
    assert done.exit_code == 2
    assert "the code is empty" in done.output


def test_no_menu_requires_a_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    done = runner.invoke(client_app, ["--no-menu"])
    assert done.exit_code == 1
    assert "requires the CODE" in done.output
