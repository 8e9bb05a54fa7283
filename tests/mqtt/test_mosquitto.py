"""With a real Mosquitto: what is told, who may ask for what, and a broker that comes and goes."""

from __future__ import annotations

import asyncio
import json
import shlex
import shutil
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import PIPE
from typing import Any

import pytest
import trustme

pytest.importorskip("aiomqtt")

import aiomqtt

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt import connection as connection_module
from robotouille_server.mqtt import link as link_module
from robotouille_server.mqtt import on_broker
from robotouille_server.mqtt import outbox as outbox_module
from robotouille_server.mqtt.models import EpisodeLife, EpisodeSteps
from tests.support.brokers import Mosquitto, missing, mosquitto, role_token
from tests.support.pages import DOCS
from tests.support.processes import started
from tests.support.servers import serving
from tests.support.worker_processes import workers

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

PATIENCE = 60
LAB = "robotouille/v1/lab"


@dataclass
class Heard:
    """What a laboratory hears on the broker."""

    client: aiomqtt.Client
    messages: list[tuple[str, Any, bool]] = field(default_factory=list)
    news: asyncio.Event = field(default_factory=asyncio.Event)

    async def listen(self) -> None:
        async for message in self.client.messages:
            if not message.topic.matches("+/+/+/commands"):
                content = json.loads(message.payload)
                self.messages.append((str(message.topic), content, message.retain))
            self.news.set()

    def on(self, end: str) -> list[Any]:
        return [content for topic, content, _ in self.messages if topic.endswith(end)]

    async def until(self, reached: Callable[[], object]) -> None:
        async with asyncio.timeout(PATIENCE):
            while not reached():
                self.news.clear()
                await self.news.wait()

    async def ask(self, **command: Any) -> Any:
        """Send a command; its answer."""
        await self.client.publish(f"{LAB}/commands", json.dumps(command), qos=1)

        def answers() -> list[Any]:
            return [each for each in self.on("answers") if each.get("ref") == command["ref"]]

        await self.until(answers)
        return answers()[0]


@asynccontextmanager
async def hearing(broker: Mosquitto, **user: str) -> AsyncIterator[Heard]:
    async with aiomqtt.Client("127.0.0.1", broker.port, **user) as client:  # type: ignore[arg-type]
        heard = Heard(client)
        await client.subscribe("robotouille/v1/#", qos=1)
        listening = asyncio.create_task(heard.listen())
        try:
            yield heard
        finally:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)


@asynccontextmanager
async def on_mosquitto(folder: Path, broker: Mosquitto, **options: Any) -> AsyncIterator[Server]:
    options = {"mqtt": broker.url, "mqtt_name": "lab", "operator": False, **options}
    async with serving(folder, **options) as server, on_broker(server):
        yield server
        await server.stop()


async def reached(condition: Callable[[], object]) -> None:
    """Once something holds that nobody tells."""
    async with asyncio.timeout(PATIENCE):
        while not condition():
            await asyncio.sleep(0.02)


def test_presence_is_retained_and_a_killed_server_is_gone(tmp_path: Path) -> None:
    async def main(broker: Mosquitto) -> None:
        flags = ("--mqtt", broker.url, "--mqtt-name", "lab", "--no-operator")
        async with hearing(broker) as heard:
            for end, state in ((signal.SIGKILL, "gone"), (signal.SIGINT, "stopped")):
                with started(tmp_path / "r", *flags) as (server, text):
                    await heard.until(lambda: states(heard)[-1:] == ["online"])
                    assert heard.on("presence")[-1]["url"] in text
                    async with hearing(broker) as late:
                        await late.until(lambda late=late: late.on("presence"))  # type: ignore[misc]
                        assert late.messages[0][2], "retained"
                    server.send_signal(end)
                    await heard.until(lambda state=state: states(heard)[-1] == state)  # type: ignore[misc]
            events = [life["event"] for life in heard.on("life")]
            assert events[0] == "opened"
            assert events[-1] == "closed", "that of the first kitchen"

    def states(heard: Heard) -> list[str]:
        return [presence["state"] for presence in heard.on("presence")]

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(main(broker))


def test_two_workers_have_names_of_their_own(tmp_path: Path) -> None:
    async def main(broker: Mosquitto) -> None:
        flags = ("--mqtt", broker.url, "--mqtt-name", "lab", "--no-operator")
        topics = {f"{LAB}-w0/presence", f"{LAB}-w1/presence"}
        async with hearing(broker) as heard:
            with workers(tmp_path / "r", 2, *flags):
                await heard.until(lambda: topics <= {topic for topic, _, _ in heard.messages})

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(main(broker))


def test_life_and_steps_are_those_of_the_recording(tmp_path: Path) -> None:
    async def main(broker: Mosquitto) -> None:
        async with on_mosquitto(tmp_path / "r", broker) as server, hearing(broker) as heard:
            await reached(lambda: server.metrics.mqtt_connected)
            token = role_token(server)
            watching = await heard.ask(type="watch", ref="w", token=token, labels={"pair": "7"})
            assert watching["ok"]
            create = {
                "task": "synchronous/01",
                "labels": {"pair": "7"},
                "clock": "lockstep",
                "max_steps": 25,
            }
            answer = await heard.ask(type="open", ref="o", token=token, create=create)
            (opened,) = answer["opened"]
            async with connect(server.url, name="ada") as client:
                game = await client.join(opened["code"])
                while not game.ended:
                    await game.act(game.actions[0] if game.actions else None)
            room = server.lobby.rooms[opened["episode"]]
            await heard.until(lambda: heard.on("life") and heard.on("life")[-1]["event"] == "ended")
            await heard.until(lambda: sum(len(each["steps"]) for each in heard.on("steps")) == 25)
            await server.lobby.closed()
            recorded = read_recording(tmp_path / "r" / room.recording)
            rows = [
                row for each in heard.on("steps") for row in EpisodeSteps.model_validate(each).steps
            ]
            assert [
                (row.step, row.t, [(m.player, m.action, m.ms) for m in row.moves]) for row in rows
            ] == [
                (
                    frame["step"],
                    frame["t"],
                    [(m["player"], m["action"], m["ms"]) for m in frame["moves"]],
                )
                for frame in recorded.steps
            ]
            lives = [EpisodeLife.model_validate(each) for each in heard.on("life")]
            assert [life.event for life in lives] == ["opened", "started", "ended"]
            assert all(life.labels == {"pair": "7"} for life in lives)
            told = json.dumps(heard.messages)
            assert told.count(opened["code"]) == 1, "in the answer, and nowhere else"
            huge = b" " * 1_000_000
            await heard.client.publish(f"{LAB}/commands", huge, qos=1)
            await heard.until(lambda: not heard.on("answers")[-1]["ok"])
            assert heard.on("answers")[-1]["error"]["code"] == "message/too-large"
            assert server.metrics.mqtt_connected

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(main(broker))


def test_a_broker_asks_for_passwords_and_keeps_its_list_of_rights(tmp_path: Path) -> None:
    """The list is that of the documentation."""
    acl = (DOCS / "mqtt.md").read_text().split('title="acl"\n')[1].split("```")[0]
    users = {"robotouille": "one", "lab": "two", "dashboard": "three"}

    async def main(broker: Mosquitto) -> None:
        password = tmp_path / "password"
        password.write_text("wrong\n")
        password.chmod(0o600)
        user = {"mqtt": broker.url.replace("//", "//robotouille@"), "mqtt_password_file": password}
        async with on_mosquitto(tmp_path / "r", broker, **user) as server:
            async with connect(server.url, name="ada") as client:
                created = await client.create("synchronous/01", clock="realtime", step_rate=20.0)
                game = await client.join(created.code)
                await reached(lambda: game.step > 5)
            assert not server.metrics.mqtt_connected
        password.write_text("one\n")
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(on_mosquitto(tmp_path / "r", broker, **user))
            await reached(lambda: server.metrics.mqtt_connected)
            lab, dashboard = [
                await stack.enter_async_context(
                    hearing(broker, username=name, password=users[name])
                )
                for name in ("lab", "dashboard")
            ]
            command = {"type": "open", "ref": "a", "token": role_token(server)}
            await dashboard.client.publish(f"{LAB}/commands", json.dumps(command), qos=1)
            await lab.client.publish(f"{LAB}/commands", json.dumps({**command, "ref": "b"}), qos=1)
            await dashboard.until(lambda: dashboard.on("life"))
            await lab.until(lambda: lab.on("life"))
            await reached(lambda: server.metrics.mqtt_published >= 2)
            assert len(server.lobby.rooms) == 1, "the dashboard may not send commands"
            for heard in (lab, dashboard):
                topics = {topic.rpartition("/")[2] for topic, _, _ in heard.messages}
                assert topics <= {"presence", "life", "steps"}, "no commands, no answers of others"

    with mosquitto(tmp_path / "broker", users, acl) as broker:
        asyncio.run(main(broker))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_with_tls_the_brokers_certificate_is_checked(tmp_path: Path) -> None:
    # paho leaves a socket whose handshake has failed to the garbage collector, which warns.
    async def main(broker: Mosquitto) -> None:
        secure = {"mqtt": f"mqtts://127.0.0.1:{broker.port}"}
        ours = {**secure, "mqtt_ca": tmp_path / "broker" / "ca.pem"}
        async with on_mosquitto(tmp_path / "r", broker, **ours) as server:
            await reached(lambda: server.metrics.mqtt_connected)
        attempts: list[str] = []

        class Log:
            def warning(self, text: str, **more: str) -> None:
                attempts.append(more["reason"])

            def info(self, text: str, **more: str) -> None: ...

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(link_module, "get_logger", Log)
            async with on_mosquitto(tmp_path / "r", broker, **secure) as server:
                await reached(lambda: attempts)
                assert "CERTIFICATE_VERIFY_FAILED" in attempts[0]
                assert not server.metrics.mqtt_connected

    folder = tmp_path / "broker"
    folder.mkdir()
    authority = trustme.CA()
    authority.cert_pem.write_to_path(folder / "ca.pem")
    certificate = authority.issue_cert("127.0.0.1")
    certificate.cert_chain_pems[0].write_to_path(folder / "cert.pem")
    certificate.private_key_pem.write_to_path(folder / "key.pem")
    for name in ("cert.pem", "key.pem"):
        (folder / name).chmod(0o644)
    tls = [f"certfile {folder / 'cert.pem'}", f"keyfile {folder / 'key.pem'}"]
    with mosquitto(folder, options=tls) as broker:
        asyncio.run(main(broker))


GAMES, STEPS = 50, 40


def test_fifty_games_do_not_notice_a_broker_that_is_killed_stopped_and_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step that waited for the broker would be late by seconds."""
    monkeypatch.setattr(connection_module, "ANSWER_SECONDS", 2.0)
    monkeypatch.setattr(link_module, "MAX_PAUSE", 0.5)

    async def main(broker: Mosquitto) -> None:
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(
                on_mosquitto(tmp_path / "r", broker, max_steps=STEPS, max_episodes_per_owner=GAMES)
            )
            await reached(lambda: server.metrics.mqtt_connected)
            client = await stack.enter_async_context(connect(server.url, name="host"))
            rooms = []
            for number in range(GAMES):
                rules = {"clock": "realtime", "step_rate": 5.0, "labels": {"game": str(number)}}
                made = await client.create("synchronous/01", **rules)
                player = await stack.enter_async_context(connect(server.url, name=f"p{number}"))
                await player.join(made.code)
                rooms.append(server.lobby.rooms[made.episode])
            async with hearing(broker) as heard:
                watching = await heard.ask(type="watch", ref="w", token=role_token(server))
                assert watching["ok"]
                await heard.until(lambda: heard.on("steps"))
                before = rooms[-1].episode.step
            broker.stop()
            await reached(lambda: rooms[-1].episode.step > before + 6)
            assert not server.metrics.mqtt_connected
            broker.start()
            async with hearing(broker) as heard:
                await heard.until(lambda: heard.on("presence") and heard.on("steps"))
                broker.send_signal(signal.SIGSTOP)
                before = rooms[-1].episode.step
                await reached(lambda: rooms[-1].episode.step > before + 6)
                broker.send_signal(signal.SIGCONT)
                await reached(lambda: all(room.episode.ended for room in rooms))
            late = server.metrics.lateness.counts
            assert sum(late) == GAMES * STEPS
            assert late[-1] == 0, "late by more than a second"
            assert server.metrics.mqtt_dropped_messages == 0
            await server.lobby.closed()
        for room in rooms:
            recording = read_recording(tmp_path / "r" / room.recording)
            assert len(recording.steps) == STEPS

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(main(broker))


def test_a_stopped_broker_costs_bounded_memory_and_what_is_dropped_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_module, "ANSWER_SECONDS", 0.5)
    monkeypatch.setattr(link_module, "MAX_PAUSE", 0.5)
    monkeypatch.setattr(outbox_module, "MAX_STEPS", 20)

    async def main(broker: Mosquitto) -> None:
        async with on_mosquitto(tmp_path / "r", broker) as server:
            await reached(lambda: server.metrics.mqtt_connected)
            async with connect(server.url, name="ada") as client, hearing(broker) as heard:
                rules = {"clock": "realtime", "step_rate": 30.0, "max_steps": 5000}
                game = await client.join((await client.create("synchronous/01", **rules)).code)
                room = server.lobby.rooms[game.episode]
                await heard.ask(type="watch", ref="w", token=role_token(server))
                await heard.until(lambda: heard.on("steps"))
                broker.send_signal(signal.SIGSTOP)
                room.announce("The broker is asked for nothing more.")
                room.pause()
                room.resume()
                await reached(lambda: server.metrics.mqtt_dropped_steps > 50)
                assert not server.metrics.mqtt_connected
                broker.send_signal(signal.SIGCONT)
                await heard.until(lambda: any(each.get("dropped") for each in heard.on("steps")))
                events = [life["event"] for life in heard.on("life")]
                assert events[-2:] == ["paused", "resumed"]

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(main(broker))


def test_the_documented_command_opens_episodes(tmp_path: Path) -> None:
    """By Mosquitto's own client, with a response topic of MQTT 5."""
    program = shutil.which("mosquitto_rr")
    if program is None:
        pytest.skip("Mosquitto's clients are not installed")
    shown = (DOCS / "mqtt.md").read_text().split("$ mosquitto_rr ")[1].split("\n{")[0]
    words = shlex.split(shown.replace("\\\n", " "))

    async def main(broker: Mosquitto) -> None:
        async with on_mosquitto(tmp_path / "r", broker) as server:
            await reached(lambda: server.metrics.mqtt_connected)
            token = role_token(server, Role.HOST, "study-7")
            asked = [word.replace("$TOKEN", token) for word in words]
            asked[asked.index("-h") + 1] = "127.0.0.1"
            del asked[asked.index("-u") : asked.index("-P") + 2]
            process = await asyncio.create_subprocess_exec(
                str(program), "-p", str(broker.port), "-W", "30", *asked, stdout=PIPE
            )
            answer = json.loads((await process.communicate())[0])
            assert answer["ref"] == "round-1"
            assert len(answer["opened"]) == len(server.lobby.rooms) == 2
            labels = [dict(room.labels) for room in server.lobby.rooms.values()]
            assert labels == [{"condition": "a"}] * 2

    with mosquitto(tmp_path / "broker") as broker:
        asyncio.run(main(broker))
