"""The OpenEnv server plays games over real sockets, and answers hostile clients."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import socket
import tomllib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from robotouille import World
from robotouille_evaluation.text_games import GameInstance, Instances, load_instance
from tests.support.sources import ROOT

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("robotouille_env") is None,
        reason="openenv-robotouille-env is not installed",
    ),
    # Libraries of OpenEnv's server.
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

TASK = "synchronous/01"


@asynccontextmanager
async def served(sessions: int = 8) -> AsyncIterator[str]:
    """Run the server on a free port, and return its address."""
    import uvicorn

    from robotouille_env.server.app import make_app

    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        config = uvicorn.Config(make_app(sessions=sessions), log_level="critical")
        server = uvicorn.Server(config)
        serving = asyncio.create_task(server.serve(sockets=[listening]))
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            server.should_exit = True
            await serving


def client(url: str) -> Any:
    """Return a session of the environment's own client."""
    from robotouille_env import RobotouilleEnv

    return RobotouilleEnv(base_url=url)


async def act(env: Any, message: str) -> Any:
    """Send an answer."""
    from robotouille_env import RobotouilleAction

    return await env.step(RobotouilleAction(message=message))


def plan_of(name: str) -> list[str]:
    """Return the sentences of a certified plan."""
    instance = load_instance(name)
    return [action.sentence for step in instance.plan(World(instance.task)) for action in step]


async def test_game_is_played_to_its_end_over_a_socket() -> None:
    async with served() as url, client(url) as env:
        result = await env.reset(task=TASK)
        first = result.observation
        assert first.prompt[0]["role"] == "system"
        assert first.legal_actions[0] in first.text
        assert not result.done

        result = await act(env, "Action: Fly to the moon")
        assert "'Fly to the moon' is not valid" in result.observation.feedback
        assert result.reward == 0
        assert (await env.state()).score["steps"] == 0

        total = 0.0
        for sentence in plan_of(TASK):
            assert not result.done
            result = await act(env, f"Reasoning: as planned\nAction: {sentence}")
            total += result.reward
        assert result.done
        assert total == pytest.approx(1)
        score = result.observation.score
        assert (score["success"], score["optimality"], score["malformed"]) == (True, 1, 1)
        with pytest.raises(RuntimeError, match="the game is over"):
            await act(env, "Do nothing")

        again = await env.reset(task=TASK, seed=1000)
        assert not again.done
        state = await env.state()
        assert (state.instance, state.step_count) == ("synchronous/01_cheese_sandwich#1000", 0)


async def test_sessions_are_isolated() -> None:
    async with served() as url, client(url) as one, client(url) as other:
        await asyncio.gather(one.reset(task=TASK), other.reset(task="multi_agent/01", seats=3))
        moved, idle = await asyncio.gather(act(one, plan_of(TASK)[0]), act(other, "Do nothing"))
        assert (moved.observation.player, idle.observation.player) == ("robot1", "robot1")
        first, second = await one.state(), await other.state()
        assert (first.score["steps"], second.score["steps"]) == (1, 0)
        assert second.players == ["robot1", "robot2", "robot3"]
        assert first.episode_id != second.episode_id


async def test_sessions_are_limited() -> None:
    async with served(sessions=1) as url, client(url) as one:
        await one.reset(task=TASK)
        async with client(url) as other:
            with pytest.raises(RuntimeError, match="capacity"):
                await other.reset(task=TASK)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"task": "synchronous/soop"}, "no task"),
        ({"task": "/etc/passwd"}, "no task"),
        ({"task": "../problems/x.json"}, "no task"),
        ({"task": 7}, "task: expected a text"),
        ({"task": "x" * 1_000_000}, "is not an instance"),
        ({"task": TASK, "split": "synchronous/test"}, "not both"),
        ({"task": TASK, "seats": 40}, "seats"),
        ({"task": TASK, "seed": 10**40}, "is not an instance"),
        ({"split": "soups"}, "expected one of synchronous/train"),
        ({"split": "synchronous/test", "index": 10_000}, "has the instances 0 to 99"),
        ({"split": "synchronous/test", "index": -1}, "index: expected an integer from 0"),
        ({"split": "synchronous/train", "index": 10**40}, "no instance"),
        ({"index": True}, "index: expected an integer from 0"),
        ({"agent": "os:system"}, "unknown argument 'agent'"),
    ],
)
async def test_wrong_reset_says_what_is_wrong(arguments: dict[str, Any], why: str) -> None:
    from robotouille import RobotouilleError
    from robotouille_env.server.environment import RobotouilleEnvironment

    with pytest.raises(RobotouilleError, match=why):
        RobotouilleEnvironment().reset(**arguments)


async def test_hostile_messages_get_errors_and_the_game_goes_on() -> None:
    from websockets.asyncio.client import connect

    async with served() as url, connect(url.replace("http", "ws") + "/ws") as connection:

        async def exchange(message: object) -> dict[str, Any]:
            raw = message if isinstance(message, str) else json.dumps(message)
            await connection.send(raw)
            found: dict[str, Any] = json.loads(await connection.recv())
            return found

        def step(message: object) -> dict[str, Any]:
            return {"type": "step", "data": {"message": message}}

        early = await exchange(step("Do nothing"))
        assert "send reset first" in early["data"]["message"]
        assert (await exchange({"type": "reset", "data": {"task": TASK}}))["type"] == "observation"
        for wrong in (
            "no json",
            {"type": "dance"},
            {"type": "step"},
            {"type": "step", "data": {"message": 7}},
            {"type": "step", "data": {"answer": "Do nothing"}},
            {"type": "reset", "data": {"task": "synchronous/soop"}},
            {"type": "reset", "data": [1]},
        ):
            found = await exchange(wrong)
            assert found["type"] == "error"
            assert found["data"]["message"]
        for text in ("", "\ud800", "x" * 1_000_000, "Action: " + "x" * 1_000_000, '{"a": [}'):
            found = await exchange(step(text))
            assert found["type"] == "observation"
            assert found["data"]["reward"] == 0
        assert (await exchange({"type": "state"}))["data"]["score"]["malformed"] == 5


async def test_http_lists_tasks_and_refuses_unknown_ones() -> None:
    import httpx

    async with served() as url, httpx.AsyncClient(base_url=url) as http:
        assert (await http.get("/health")).json() == {"status": "healthy"}
        assert (await http.get("/metadata")).json()["name"] == "robotouille_env"
        schema = (await http.get("/schema")).json()
        assert schema["action"]["required"] == ["message"]
        assert "legal_actions" in schema["observation"]["properties"]
        splits = (await http.get("/robotouille_env/splits")).json()
        assert {"name": "shifts/test"}.items() <= splits[-1].items()
        task = {"split": "synchronous/test", "index": 1}
        found = (await http.post("/robotouille_env/task", json=task)).json()
        assert found["task"]["id"] == "generated/synchronous/02_lettuce_sandwich_s42"
        refused = await http.post("/reset", json={"task": "synchronous/soop"})
        assert (refused.status_code, "no task" in refused.text) == (422, True)


@pytest.mark.parametrize("path", ["/reset", "/mcp"])
async def test_pages_of_other_sites_are_refused(path: str) -> None:
    import httpx
    from websockets.asyncio.client import connect
    from websockets.exceptions import InvalidStatus

    create = json.dumps({"jsonrpc": "2.0", "method": "openenv/session/create", "id": 1})
    async with served() as url, httpx.AsyncClient(base_url=url) as http:
        for origin in ("https://evil.example", "null"):
            sent = {"origin": origin, "content-type": "text/plain"}
            refused = await http.post(path, content=create, headers=sent)
            assert (refused.status_code, "other sites" in refused.text) == (403, True)
            with pytest.raises(InvalidStatus, match="403"):
                await connect(url.replace("http", "ws") + "/ws", origin=origin)
        own = await http.post("/mcp", content=create, headers={"origin": url})
        assert "session_id" in own.json()["result"]


async def test_names_of_other_sites_that_lead_here_are_refused() -> None:
    import httpx

    async with served() as url, httpx.AsyncClient(base_url=url) as http:
        port = url.rpartition(":")[2]
        for host in (f"evil.example:{port}", "evil.example", "localhost.evil.example", "[", ""):
            for origin in ({}, {"origin": f"http://{host}"}):
                refused = await http.get("/health", headers={"host": host, **origin})
                assert (refused.status_code, "other sites" in refused.text) == (403, True)
        for host in (f"localhost:{port}", f"127.0.0.1:{port}", f"[::1]:{port}"):
            own = await http.get("/health", headers={"host": host, "origin": f"http://{host}"})
            assert own.status_code == 200


@pytest.mark.parametrize(
    ("own", "host", "accepted"),
    [
        ("127.0.0.1", "evil.example", False),
        ("::ffff:127.0.0.1", "evil.example", False),
        ("::ffff:127.0.0.1", "[::ffff:127.0.0.1]:8000", True),
        ("10.0.0.7", "kitchen.example", True),
    ],
)
async def test_only_servers_within_this_machine_need_its_name(
    *, own: str, host: str, accepted: bool
) -> None:
    from starlette.responses import PlainTextResponse

    from robotouille_env.server.guard import Guard

    guard = Guard(PlainTextResponse("played"))
    headers = [(b"host", host.encode())]
    scope: dict[str, Any] = {"type": "http", "path": "/", "server": (own, 8000), "headers": headers}
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    await guard(scope, receive, send)
    assert (sent[0]["status"] == 200) is accepted


async def test_large_bodies_are_refused_before_they_are_stored() -> None:
    import httpx

    from robotouille_env.server.app import make_app
    from robotouille_env.server.guard import MAX_BODY

    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        while True:
            sent += 1 << 16
            yield b" " * (1 << 16)

    transport = httpx.ASGITransport(app=make_app())
    async with httpx.AsyncClient(base_url="http://test", transport=transport) as http:
        for body in (b" " * (MAX_BODY + 1), endless()):
            refused = await http.post("/reset", content=body)
            assert (refused.status_code, "4 MiB" in refused.text) == (413, True)
        assert sent <= 2 * MAX_BODY


def test_instances_of_a_split_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from robotouille_env.server import environment

    loaded = []

    def instances(*arguments: str) -> Instances:
        loaded.append(arguments)
        return Instances(*arguments)

    monkeypatch.setattr(environment, "Instances", instances)
    for _ in range(3):
        environment.RobotouilleEnvironment().num_tasks("shifts/test")
    assert len(loaded) <= 1


async def test_one_instance_is_made_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    from robotouille_env.server import environment

    real, now, most = environment.load_instance, 0, 0

    def watched(name: str, seats: int | None) -> GameInstance:
        nonlocal now, most
        now += 1
        most = max(most, now)
        found = real(name, seats)
        now -= 1
        return found

    monkeypatch.setattr(environment, "load_instance", watched)
    resets = [
        asyncio.to_thread(environment.RobotouilleEnvironment().reset, task=f"synchronous/0{i}")
        for i in range(1, 7)
    ]
    await asyncio.gather(*resets)
    assert most == 1


def test_manifest_matches_the_package() -> None:
    import yaml

    folder = ROOT / "packages/robotouille_env"
    manifest = yaml.safe_load((folder / "openenv.yaml").read_text(encoding="utf-8"))
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == f"openenv-{manifest['name'].replace('_', '-')}"
    assert manifest["version"] == project["version"]
    module = manifest["app"].partition(":")[0].replace(".", "/")
    assert (folder / module).with_suffix(".py").exists()


def test_readme_has_the_header_of_a_space() -> None:
    import yaml

    folder = ROOT / "packages/robotouille_env"
    manifest = yaml.safe_load((folder / "openenv.yaml").read_text(encoding="utf-8"))
    start, header, _ = (folder / "README.md").read_text(encoding="utf-8").split("---\n", 2)
    space = yaml.safe_load(header)
    assert (start, space["sdk"], space["app_port"]) == ("", "docker", manifest["port"])
    assert "openenv" in space["tags"]
