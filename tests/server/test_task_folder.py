"""Folder of the operator's own tasks."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import threading
from pathlib import Path

import pytest

from robotouille.certification import step_limit
from robotouille.certification.certificate import Certificate, load_certificate
from robotouille.certification.stars import star_limits
from robotouille.certification.step_limit import people_step_limit
from robotouille.domain.loading import load_task
from robotouille.domain.task import Task
from robotouille.errors import ProtocolError
from robotouille.installation import data_folder
from robotouille.protocol import messages
from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server.cli import SERVER, _greeting, first_room
from robotouille_server.runtime.task_folder import TaskFolderError, read_task_folder
from tests.support.operator import viewing
from tests.support.pixels import png
from tests.support.servers import crash, raw, serving, with_clients
from tests.support.virtual_time import virtual

SVG = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8">
<rect width="8" height="8" fill="#07fa3c"/></svg>"""


@pytest.fixture
def bistro(tmp_path: Path) -> Path:
    """Create a task like the shipped diner, with pictures of its own."""
    folder = tmp_path / "tasks"
    pictures = folder / "bistro"
    pictures.mkdir(parents=True)
    places = {
        "bistro.json": data_folder("domains") / "diner.json",
        "bistro.input.json": data_folder("domains") / "diner.input.json",
        "bistro.rendering.json": data_folder("renderings") / "diner.json",
        "crepes.json": data_folder("problems") / "examples/pancakes.json",
    }
    for name, path in places.items():
        text = path.read_text(encoding="utf-8").replace('"diner"', '"bistro"')
        text = text.replace(".svg", ".png").replace("griddle.png", "griddle.svg")
        value = json.loads(text)
        value.pop("input_json", None)
        value.pop("rendering_json", None)
        (folder / name).write_text(json.dumps(value), encoding="utf-8")
    for number, path in enumerate(sorted((data_folder("assets") / "diner").iterdir())):
        (pictures / f"{path.stem}.png").write_bytes(png((250, 10 * number, 7)))
    (pictures / "griddle.png").unlink()
    (pictures / "griddle.svg").write_text(SVG)
    return folder


@pytest.mark.slow
@virtual
async def test_own_task_is_opened_by_name_and_drawn_with_its_pictures(
    tmp_path: Path, bistro: Path
) -> None:
    pygame = pytest.importorskip("pygame")
    from robotouille_client.window.app.remote_game import fetch_look
    from robotouille_client.window.drawing.painter import Painter
    from robotouille_client.window.sources.remote import RemoteSource

    def painted(painter: Painter, source: RemoteSource) -> set[tuple[int, ...]]:
        surface = pygame.Surface((640, 360))
        painter.paint(surface, source.view())
        return {tuple(surface.get_at((x, y)))[:3] for x in range(640) for y in range(360)}

    pygame.font.init()
    cache = tmp_path / "cache"
    cache.mkdir()
    async with (
        serving(tmp_path / "recordings", tasks=bistro) as server,
        connect(server.url, name="ada") as ada,
    ):
        game = await ada.join((await ada.create("crepes", max_steps=3)).code)
        look = await fetch_look(ada, cache)
        assert look is not None
        assert {path.suffix for path in cache.iterdir()} == {".png", ".svg"}
        bistro.rename(tmp_path / "elsewhere")  # The client is on another machine.
        source = RemoteSource(game, lambda: 0.0)
        own = {(250, 10 * number, 7) for number in range(10)}
        seen = painted(Painter(look.rendering, look.pictures), source)
        assert seen & own
        assert (7, 250, 60) in seen
        assert not painted(Painter(), source) & (own | {(7, 250, 60)})
        for _ in range(3):
            await game.act(None)
    (file,) = (tmp_path / "recordings").glob("*.rbt")
    recording = read_recording(file)
    assert recording.task.name == "crepes"
    assert recording.verify().ok


@virtual
async def test_operators_get_the_pictures(tmp_path: Path, bistro: Path) -> None:
    async with viewing(tmp_path / "recordings", tasks=bistro) as (server, _, api):
        path = f"/api/episodes/{server.lobby.create(messages.Create(task='crepes')).id}"
        look = (await api.get(f"{path}/kitchen"))["look"]
        assert set(look["rendering"]) >= {"assets"}
        found = await api.get(f"{path}/pictures/{look['pictures']['griddle.svg']}")
        assert b"#07fa3c" in base64.b64decode(found["data"])
        assert (await api.http.get(f"{path}/pictures/{'0' * 64}")).status_code == 404


@virtual
async def test_pictures_survive_a_restart(tmp_path: Path, bistro: Path) -> None:
    recordings = tmp_path / "recordings"
    join = {"type": "join", "role": "spectator"}
    async with serving(recordings, tasks=bistro) as first, raw(first) as ada:
        create = {"type": "create", "task": "crepes", "open_for": 9000.0}
        code = (await ada.ask(create, "created"))["code"]
        await crash(first)
    async with serving(recordings, seed=2, tasks=bistro) as second, raw(second) as ada:
        await ada.ask({**join, "episode": code}, "joined")
        received = await ada.ask({"type": "get_rendering", "ref": 7}, "rendering")
        assert received["pictures"]
        digest = next(iter(received["pictures"].values()))
        picture = await ada.ask({"type": "get_picture", "digest": digest}, "picture")
        assert picture["digest"] == digest
        refused = await ada.ask({"type": "get_picture", "digest": "0" * 64}, "picture")
        assert refused["code"] == "message/invalid-field"


@virtual
async def test_shipped_task_has_no_rendering_message(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
        await ada.join((await ada.create("synchronous/01")).code)
        assert (await ada.rendering()).rendering is None


@virtual
@pytest.mark.parametrize("rate", [None, 4.0])
async def test_clients_receive_the_steps_for_stars(tmp_path: Path, rate: float | None) -> None:
    rules = {"clock": "realtime", "step_rate": rate} if rate else {"clock": "lockstep"}
    async with serving(tmp_path) as server, connect(server.url, name="ada") as ada:
        game = await ada.join((await ada.create("synchronous/01", **rules)).code)
        limits = star_limits(game.world.task, rate)
        assert limits is not None
        assert (await ada.rendering()).stars == list(limits)
        await ada.leave()
        await ada.join((await ada.create("shifts/01", seats=1)).code)
        assert (await ada.rendering()).stars is None


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[threading.Thread]:
    """Return the threads that simulate plans. No plan is known at first."""
    monkeypatch.setattr(step_limit, "_lengths", {})
    threads: list[threading.Thread] = []

    def noted(task: Task) -> Certificate:
        threads.append(threading.current_thread())
        return load_certificate(task)

    monkeypatch.setattr(step_limit, "load_certificate", noted)
    return threads


@virtual
async def test_plans_for_stars_are_simulated_beside_the_event_loop(
    tmp_path: Path, searches: list[threading.Thread]
) -> None:
    """Several players who ask for the same task at once cause one simulation."""
    async with with_clients(tmp_path, "ada", "bob", "eve") as (_, ada, *others):
        code = (await ada.create("synchronous/01", clock="lockstep", max_steps=9)).code
        await ada.join(code)
        for other in others:
            await other.join(code, role="spectator")
        answers = await asyncio.gather(*(each.rendering() for each in (ada, *others)))
        assert all(answer.stars for answer in answers)
    (thread,) = searches
    assert thread is not threading.current_thread()


@virtual
async def test_plans_for_step_limits_are_simulated_beside_the_event_loop(
    tmp_path: Path, searches: list[threading.Thread]
) -> None:
    async with serving(tmp_path) as server, raw(server) as host, raw(server) as other:
        create = {"type": "create", "task": "multi_agent/01", "timing": "people", "clock": "turn"}
        answers = await asyncio.gather(*(one.ask(create, "created") for one in (host, other)))
        limits = {server.lobby.find(each["code"]).episode.rules.max_steps for each in answers}
        assert limits == {people_step_limit(load_task("multi_agent/01", timing="people"), None)}
    (thread,) = searches
    assert thread is not threading.current_thread()


@virtual
async def test_unknown_name_suggests_a_task_of_the_folder(tmp_path: Path, bistro: Path) -> None:
    async with (
        serving(tmp_path / "recordings", tasks=bistro) as server,
        connect(server.url, name="ada") as ada,
    ):
        with pytest.raises(ProtocolError, match="'crepse'; did you mean 'crepes'") as refused:
            await ada.create("crepse")
        assert refused.value.code == "task/unknown"
        with pytest.raises(ProtocolError, match="did you mean 'multi_agent/01_lettuce_burger'"):
            await ada.create("multi_agent/01_letuce_burger")


@virtual
async def test_restarted_server_prints_only_its_own_code(tmp_path: Path) -> None:
    async with serving(tmp_path) as first, raw(first) as ada:
        await ada.ask({"type": "create", "task": "synchronous/01", "open_for": 9000.0}, "created")
        await crash(first)
    async with serving(tmp_path, seed=2) as second:
        assert first_room(second) is None
        assert "continuing 1 earlier episode, so no new one" in _greeting(second, None, "", 1)
        own = second.lobby.create(messages.Create(), owner=SERVER)
        assert first_room(second) is own


@virtual
@pytest.mark.parametrize(("grace", "minutes"), [(30.0, 10), (1200.0, 20)])
async def test_greeting_says_when_the_kitchen_closes(
    tmp_path: Path, grace: float, minutes: int
) -> None:
    async with serving(tmp_path, grace=grace) as server:
        greeting = _greeting(server, first_room(server), "")
        assert f"it closes after {minutes} minutes without players\n" in greeting


@virtual
async def test_greeting_names_programs_that_can_play_with_limited_sight(tmp_path: Path) -> None:
    async with serving(tmp_path, sight=2) as server:
        greeting = _greeting(server, first_room(server), "")
        assert "robotouille-bot llm --model MODEL --episode" in greeting
        assert "robotouille-bot planner" not in greeting
        assert "in a browser" not in greeting


@virtual
async def test_greeting_says_how_to_open_more_games(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = first_room(server)
        own = f"another game:  robotouille-client --create TASK --url {server.public_url}\n"
        assert own in _greeting(server, room, "")
        assert "Open episodes" not in _greeting(server, room, "")
        assert "the button Open episodes on the operator page\n" in _greeting(
            server, room, "http://127.0.0.1:8766/"
        )


def test_links_out_of_the_folder_are_refused(bistro: Path) -> None:
    (bistro / "secret.json").symlink_to("/etc/passwd")
    (bistro / "inside.json").symlink_to(bistro / "crepes.json")
    with pytest.raises(TaskFolderError, match=r"secret\.json: a link that leads out") as refused:
        read_task_folder(bistro)
    assert "inside" not in str(refused.value)


def test_every_invalid_file_is_reported(bistro: Path) -> None:
    (bistro / "broken.json").write_text("{")
    (bistro / "poor.json").write_text('{"width": 3, "height": 3, "goal": 7}')
    with pytest.raises(TaskFolderError) as refused:
        read_task_folder(bistro)
    assert "broken.json" in str(refused.value)
    assert "poor.json" in str(refused.value)


def test_invalid_picture_is_reported(bistro: Path) -> None:
    picture = next((bistro / "bistro").glob("*.png"))
    picture.write_bytes(picture.read_bytes()[:40])
    with pytest.raises(TaskFolderError, match=f"bistro/{picture.name}: is a damaged PNG"):
        read_task_folder(bistro)
    picture.write_bytes(png((1, 2, 3)))
    (bistro / "bistro/griddle.svg").write_text('<svg viewBox="0 0 1 1">')
    with pytest.raises(TaskFolderError, match=r"bistro/griddle.svg: is not an SVG"):
        read_task_folder(bistro)


def test_huge_picture_is_not_read(bistro: Path) -> None:
    picture = next((bistro / "bistro").glob("*.png"))
    os.truncate(picture, 16_777_217)
    with pytest.raises(TaskFolderError, match=f"{picture.name}: has more than 16,777,216 bytes"):
        read_task_folder(bistro)


def test_too_many_files_are_refused(bistro: Path) -> None:
    for number in range(2_001):
        os.close(os.open(bistro / f"{number}.txt", os.O_CREAT))
    with pytest.raises(TaskFolderError, match="more than 2,000 files"):
        read_task_folder(bistro)


def test_missing_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TaskFolderError, match="the folder does not exist"):
        read_task_folder(tmp_path / "none")
    with pytest.raises(TaskFolderError, match="no problem file"):
        read_task_folder(tmp_path)
