"""Publications, permissions and interruptions with a real Mosquitto."""

from __future__ import annotations

import asyncio
import json
import shlex
import shutil
import signal
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import PIPE
from typing import Any

import aiomqtt
import pytest
import trustme
from paho.mqtt.properties import VariableByteIntegers

from robotouille.protocol.messages import Create
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt import service as service_module
from robotouille_server.mqtt.messages import LifecycleEvent
from robotouille_server.mqtt.service import on_broker
from tests.mqtt.lying import packet, text
from tests.support.brokers import Mosquitto, missing, mosquitto, role_token
from tests.support.pages import DOCS
from tests.support.processes import started
from tests.support.servers import serving
from tests.support.worker_processes import free_ports

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]

PATIENCE = 60
LAB = "robotouille/v1/lab"


@dataclass
class Subscriber:
    """Client of the broker that keeps all messages it receives."""

    client: aiomqtt.Client
    messages: list[tuple[str, Any, bool]] = field(default_factory=list)
    received: asyncio.Event = field(default_factory=asyncio.Event)

    async def listen(self) -> None:
        async for message in self.client.messages:
            if not message.topic.matches("+/+/+/commands"):
                content = json.loads(message.payload)
                self.messages.append((str(message.topic), content, message.retain))
            self.received.set()

    def on(self, end: str) -> list[Any]:
        return [content for topic, content, _ in self.messages if topic.endswith(end)]

    def states(self) -> list[str]:
        return [presence["state"] for presence in self.on("presence")]

    async def until(self, reached: Callable[[], object]) -> None:
        async with asyncio.timeout(PATIENCE):
            while not reached():
                self.received.clear()
                await self.received.wait()

    async def ask(self, **command: Any) -> Any:
        """Send a command and return the reply."""
        await self.client.publish(f"{LAB}/commands", json.dumps(command), qos=1)

        def answers() -> list[Any]:
            return [each for each in self.on("answers") if each.get("ref") == command["ref"]]

        await self.until(answers)
        return answers()[0]


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    with mosquitto(tmp_path / "broker") as broker:
        yield broker


@asynccontextmanager
async def subscribed(broker: Mosquitto, **user: str) -> AsyncIterator[Subscriber]:
    async with aiomqtt.Client("127.0.0.1", broker.port, **user) as client:  # type: ignore[arg-type]
        subscriber = Subscriber(client)
        await client.subscribe("robotouille/v1/#", qos=1)
        listening = asyncio.create_task(subscriber.listen())
        try:
            yield subscriber
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
    """Wait until a condition holds, by polling."""
    async with asyncio.timeout(PATIENCE):
        while not condition():
            await asyncio.sleep(0.02)


async def test_next_server_takes_over_the_name(tmp_path: Path, broker: Mosquitto) -> None:
    async with subscribed(broker) as lab, on_mosquitto(tmp_path / "a", broker) as old:
        await lab.until(lambda: lab.states() == ["online"])
        code = old.lobby.create(Create()).code
        old.lobby.drain()
        async with on_mosquitto(tmp_path / "b", broker) as new:
            await lab.until(lambda: len(lab.states()) == 2)
            old.lobby.find(code).abort("over")
            await lab.until(lambda: "closed" in [each["event"] for each in lab.on("life")])
            reply = await lab.ask(type="list", ref="l", token=role_token(new))
            assert (reply["ok"], reply.get("total", 0)) == (True, 0), reply
            await old.stop()
        await lab.until(lambda: len(lab.states()) == 3)
    assert lab.states() == ["online", "online", "stopped"]
    assert all(each["ok"] for each in lab.on("answers"))


async def test_presence_is_retained_and_a_killed_server_is_gone(
    tmp_path: Path, broker: Mosquitto
) -> None:
    flags = ("--mqtt", broker.url, "--mqtt-name", "lab", "--no-operator")
    async with subscribed(broker) as subscriber:
        for end, state in ((signal.SIGKILL, "gone"), (signal.SIGINT, "stopped")):
            with started(tmp_path / "r", *flags) as (server, text):
                await subscriber.until(lambda: subscriber.states()[-1:] == ["online"])
                assert subscriber.on("presence")[-1]["url"] in text
                async with subscribed(broker) as late:
                    await late.until(lambda late=late: late.on("presence"))  # type: ignore[misc]
                    assert late.messages[0][2], "retained"
                server.send_signal(end)
                await subscriber.until(lambda state=state: subscriber.states()[-1] == state)  # type: ignore[misc]
        events = [life["event"] for life in subscriber.on("life")]
        assert events[0] == "opened"
        assert events[-1] == "closed", "the first kitchen had no participants"


async def test_lifecycle_events_and_steps_are_published(tmp_path: Path, broker: Mosquitto) -> None:
    async with on_mosquitto(tmp_path / "r", broker) as server, subscribed(broker) as subscriber:
        await reached(lambda: server.metrics.mqtt_connected)
        token = role_token(server)
        watching = await subscriber.ask(type="watch", ref="w", token=token, labels={"pair": "7"})
        assert watching["ok"]
        create = {
            "task": "synchronous/01",
            "labels": {"pair": "7"},
            "clock": "lockstep",
            "max_steps": 25,
        }
        answer = await subscriber.ask(type="open", ref="o", token=token, create=create)
        (opened,) = answer["opened"]
        async with connect(server.url, name="ada") as client:
            game = await client.join(opened["code"])
            while not game.ended:
                await game.act(game.actions[0] if game.actions else None)
        await subscriber.until(
            lambda: sum(len(each["steps"]) for each in subscriber.on("steps")) == 25
        )
        await subscriber.until(lambda: len(subscriber.on("life")) == 3)
        lives = [LifecycleEvent.model_validate(each) for each in subscriber.on("life")]
        assert [life.event for life in lives] == ["opened", "started", "ended"]
        assert all(life.labels == {"pair": "7"} for life in lives)
        published = json.dumps(subscriber.messages)
        assert published.count(opened["code"]) == 1, "only the reply contains the code"


async def test_refused_commands_do_not_displace_valid_ones(
    tmp_path: Path, broker: Mosquitto
) -> None:
    async with on_mosquitto(tmp_path / "r", broker) as server, subscribed(broker) as subscriber:
        await reached(lambda: server.metrics.mqtt_connected)
        refused = {"type": "list", "token": "nonsense"}
        for number in range(80):
            payload = json.dumps({**refused, "ref": f"x{number}"})
            await subscriber.client.publish(f"{LAB}/commands", payload, qos=1)
        listed = await subscriber.ask(type="list", ref="l", token=role_token(server))
        assert (listed["ok"], listed["subject"]) == (True, "lab")
        answers = [each for each in subscriber.on("answers") if not each["ok"]]
        assert [each["ref"] for each in answers] == [f"x{number}" for number in range(80)]
        assert not any("subject" in each for each in answers)


async def test_commands_with_many_properties_are_dropped_and_retained_ones_not_delivered(
    tmp_path: Path, broker: Mosquitto
) -> None:
    # paho would read them for half a second, and the retained ones at each connection.
    topic, many = text(f"{LAB}/commands"), b"\x26\0\0\0\0" * 10_000
    size: bytes = VariableByteIntegers.encode(len(many))  # type: ignore[no-untyped-call]
    opening = packet(0x10, text("MQTT") + b"\5\2\0\x3c\0" + text("flood"))
    async with on_mosquitto(tmp_path / "r", broker) as server, subscribed(broker) as subscriber:
        await reached(lambda: server.metrics.mqtt_connected)
        reader, writer = await asyncio.open_connection("127.0.0.1", broker.port)
        writer.write(opening + packet(0x33, topic + b"\0\1" + size + many + b"{}"))
        await reader.readuntil(b"\x40\x02\0\1")  # Acknowledged, so it is retained.
        writer.close()
        listed = await subscriber.ask(type="list", ref="l", token=role_token(server))
        assert listed["ok"]
        assert server.metrics.mqtt_dropped_commands == 1
    async with on_mosquitto(tmp_path / "r", broker) as server, subscribed(broker) as subscriber:
        await reached(lambda: server.metrics.mqtt_connected)
        assert (await subscriber.ask(type="list", ref="m", token=role_token(server)))["ok"]
        assert server.metrics.mqtt_dropped_commands == 0


async def test_documented_access_list_restricts_users(tmp_path: Path) -> None:
    acl = (DOCS / "mqtt.md").read_text().split('title="acl"\n')[1].split("```")[0]
    users = {"robotouille": "one", "lab": "two", "dashboard": "three"}

    with mosquitto(tmp_path / "broker", users, acl) as broker:
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
                    subscribed(broker, username=name, password=users[name])
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
            for subscriber in (lab, dashboard):
                topics = {topic.rpartition("/")[2] for topic, _, _ in subscriber.messages}
                assert topics <= {"presence", "life", "steps"}, (
                    "no commands, and no replies to others"
                )


async def test_documented_listener_keeps_the_servers_client_id(tmp_path: Path) -> None:
    conf = (DOCS / "mqtt.md").read_text().split('title="mosquitto.conf"\n')[1].split("```")[0]
    port = free_ports(1)
    others = f"listener {port} 127.0.0.1" + conf.partition("listener 1884")[2]
    users = {"robotouille": "one", "dashboard": "three"}
    with mosquitto(tmp_path / "broker", users, options=others.splitlines()) as broker:
        (password := tmp_path / "password").write_text("one\n")
        password.chmod(0o600)
        user = {"mqtt": broker.url.replace("//", "//robotouille@"), "mqtt_password_file": password}
        async with (
            on_mosquitto(tmp_path / "r", broker, **user) as server,
            subscribed(broker, username="robotouille", password="one") as lab,
        ):
            await lab.until(lambda: lab.states() == ["online"])
            dashboard: dict[str, Any] = {"username": "dashboard", "password": "three"}
            async with aiomqtt.Client("127.0.0.1", port, identifier="robotouille-lab", **dashboard):
                assert (await lab.ask(type="list", ref="l", token=role_token(server)))["ok"]
            assert lab.states() == ["online"], "the server had to connect again"


async def test_answers_that_the_broker_does_not_accept_are_refused(tmp_path: Path) -> None:
    with mosquitto(tmp_path / "broker", options=["max_packet_size 2000"]) as broker:
        async with on_mosquitto(tmp_path / "r", broker) as server, subscribed(broker) as lab:
            await reached(lambda: server.metrics.mqtt_connected)
            for _ in range(30):
                server.lobby.create(Create())
            token = role_token(server)
            refused = await lab.ask(type="list", ref="all", token=token)
            assert refused["error"]["code"] == "message/too-large"
            assert (refused["ok"], refused["subject"]) == (False, "lab")
            listed = await lab.ask(type="list", ref="last", token=token, skip=29)
            assert (len(listed["episodes"]), listed["total"]) == (1, 30)
            assert lab.states() == ["online"], "the connection was lost"
            assert len(lab.on("life")) == 30


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
async def test_tls_verifies_the_brokers_certificate(tmp_path: Path) -> None:
    # paho does not close a socket after a failed handshake, so Python warns when it collects it.
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
            patch.setattr(service_module, "get_logger", Log)
            async with on_mosquitto(tmp_path / "r", broker, **secure) as server:
                await reached(lambda: attempts)
                assert "CERTIFICATE_VERIFY_FAILED" in attempts[0]
                assert not server.metrics.mqtt_connected


async def test_documented_command_opens_episodes(tmp_path: Path, broker: Mosquitto) -> None:
    # Mosquitto's own client, with a response topic of MQTT 5.
    program = shutil.which("mosquitto_rr")
    if program is None:
        pytest.skip("Mosquitto's clients are not installed")
    shown = (DOCS / "mqtt.md").read_text().split("$ mosquitto_rr ")[1].split("\n{")[0]
    words = shlex.split(shown.replace("\\\n", " "))

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
