"""The lab of `docker-compose.yml` runs: each service as a process, with its own files."""

from __future__ import annotations

import asyncio
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import Request, urlopen

import pytest
import yaml

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_client import connect
from tests.support.lab import Lab, lab, missing
from tests.support.sources import ROOT

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
]
SERVICES = ("server", "mosquitto", "postgres", "catalogue", "prometheus", "caddy")
SECONDS = 60
DASHBOARD = json.loads((ROOT / "lab/grafana/dashboards/robotouille.json").read_text())
TARGETS = [target for panel in DASHBOARD["panels"] for target in panel.get("targets", [])]
RULES = yaml.safe_load((ROOT / "lab/robotouille.rules.yml").read_text())["groups"][0]["rules"]


@pytest.fixture(scope="module")
def running() -> Iterator[Lab]:
    """All of it but Grafana, which Debian has no package of."""
    with lab(*SERVICES) as made:
        yield made


def eventually(look: Callable[[], Any]) -> Any:
    """What a look finds, once it finds something."""
    end = time.monotonic() + SECONDS
    while not (found := look()):
        assert time.monotonic() < end, "it has not happened"
        time.sleep(0.1)
    return found


def test_all_are_well(running: Lab) -> None:
    assert all(running.health(name) for name in SERVICES)
    assert running.services.keys() - set(SERVICES) == {"grafana"}


def test_every_host_and_port_that_files_have_was_needed(running: Lab) -> None:
    assert running.used == running.hosts.keys() - {"127.0.0.1:8766"}


def test_a_health_check_tells_when_one_is_gone() -> None:
    with lab("mosquitto") as made:
        made.stop("mosquitto")
        assert not made.health("mosquitto")
        made.start("mosquitto")
        made.await_health("mosquitto")


# Prometheus


def prometheus(running: Lab, path: str, **query: str) -> Any:
    url = f"http://127.0.0.1:{running.port[9090]}/api/v1/{path}?{urlencode(query)}"
    with urlopen(url, timeout=SECONDS) as answer:
        content = json.load(answer)
    assert content["status"] == "success"
    return content["data"]


def test_prometheus_asks_the_server_and_knows_our_rules(running: Lab) -> None:
    def asked() -> bool:
        return any(
            target["health"] == "up" for target in prometheus(running, "targets")["activeTargets"]
        )

    eventually(asked)
    (group,) = prometheus(running, "rules")["groups"]
    assert [rule["name"] for rule in group["rules"]] == [rule["alert"] for rule in RULES]
    assert eventually(lambda: prometheus(running, "query", query="robotouille_episodes")["result"])


def test_every_panel_is_answered(running: Lab) -> None:
    for target in TARGETS:
        if "expr" in target:
            prometheus(running, "query", query=target["expr"])


# Caddy


@pytest.fixture
def front(running: Lab, monkeypatch: pytest.MonkeyPatch) -> str:
    """The address that others are given; Caddy's own authority is trusted."""
    authority = running.folder / "lab/data/caddy/caddy/pki/authorities/local/root.crt"
    monkeypatch.setenv("SSL_CERT_FILE", str(eventually(lambda: authority.is_file() and authority)))
    return f"localhost:{running.port[443]}"


def minted(running: Lab, role: str) -> str:
    code = "from robotouille_server.auth.token_cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "mint", role],
        env=running.environment("server"),
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def status(url: str) -> int:
    try:
        with urlopen(url, timeout=SECONDS) as answer:
            return int(answer.status)
    except HTTPError as error:
        return error.code


async def play(front: str, token: str, condition: str) -> str:
    """An episode by random actions, over TLS; its id."""
    rng = random.Random(1)
    async with asyncio.timeout(SECONDS), connect(f"wss://{front}", name="ada", token=token) as ada:
        labels = {"condition": condition}
        created = await ada.create("synchronous/01", clock="turn", max_steps=5, labels=labels)
        game = await ada.join(created.code)
        while not game.ended:
            await game.act(rng.choice(game.actions))
            if not game.ended and not game.my_move:
                await game.next_event()
        return created.episode


async def role(front: str) -> str:
    async with connect(f"wss://{front}", name="stranger") as stranger:
        return stranger.role


def test_games_come_through_caddy_with_tls(running: Lab, front: str) -> None:
    assert asyncio.run(role(front)) == "player"
    assert status(f"https://{front}/healthz") == 200
    assert status(f"https://{front}/metrics") == 404
    assert status(f"https://{front}/grafana/") == 502
    plain = HTTPConnection("localhost", running.port[80], timeout=SECONDS)
    plain.request("GET", "/healthz")
    assert plain.getresponse().getheader("Location") == "https://localhost/healthz"
    plain.close()


def test_an_episode_is_in_the_catalogue_soon(running: Lab, front: str) -> None:
    episode = asyncio.run(play(front, minted(running, "host"), "a'b"))
    query = (
        "SELECT l.value FROM episodes e JOIN labels l ON l.episode_id = e.id "
        f"WHERE e.episode = '{episode}'"
    )
    assert eventually(lambda: running.ask(query).stdout) == "a'b\n"


def test_who_reads_the_catalogue_can_only_read(running: Lab) -> None:
    for target in TARGETS:
        if "rawSql" in target:
            done = running.ask(target["rawSql"])
            assert done.returncode == 0, done.stderr
    for change in ("DELETE FROM episodes", "CREATE TABLE x ()"):
        assert "permission denied" in running.ask(f"SET TRANSACTION READ WRITE; {change}").stderr


def test_the_operators_page_asks_for_a_token(running: Lab) -> None:
    url = f"http://127.0.0.1:{running.port[8766]}"
    assert status(f"{url}/") == 200
    assert status(f"{url}/api/overview") == 401
    header = {"Authorization": f"Bearer {minted(running, 'operator')}"}
    with urlopen(Request(f"{url}/api/overview", headers=header), timeout=SECONDS) as answer:
        assert answer.status == 200


# Mosquitto


def options(running: Lab, user: str) -> list[str]:
    password = (running.folder / f"lab/secrets/mqtt_{user}").read_text()
    return ["-p", str(running.port[1883]), "-u", user, "-P", password]


def heard(running: Lab, user: str, topic: str, *words: str, seconds: int = 5) -> str:
    command = ["mosquitto_sub", *options(running, user), "-t", topic, "-W", str(seconds), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS).stdout


def publish(running: Lab, user: str, topic: str, text: str) -> None:
    command = ["mosquitto_pub", *options(running, user), "-t", topic, "-m", text, "-q", "1", "-r"]
    subprocess.run(command, capture_output=True, timeout=SECONDS)


def test_each_user_reads_and_writes_its_own(running: Lab) -> None:
    topics = (
        "robotouille/v1/x/presence",
        "robotouille/v1/x/commands",
        "robotouille/v1/x/answers/lab",
        "other",
    )
    may_read = {"server": {"lab 1"}, "lab": {"server 0", "server 2"}, "health": set()}
    for user in may_read:
        for number, topic in enumerate(topics):
            publish(running, user, topic, f"{user} {number}")
    for user, expected in may_read.items():
        lines = heard(running, user, "#", seconds=3).splitlines()
        assert {line for line in lines if line.endswith(("0", "1", "2", "3"))} == expected, user
    publish(running, "server", topics[0], "")
    publish(running, "lab", topics[1], "")
    publish(running, "server", topics[2], "")


def test_nobody_comes_in_without_a_password(running: Lab) -> None:
    for words in ([], ["-u", "lab"], ["-u", "lab", "-P", "wrong"], ["-u", "nobody", "-P", "x"]):
        command = ["mosquitto_sub", "-p", str(running.port[1883]), *words, "-t", "#", "-W", "5"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
        assert done.returncode == 5, done.stderr
        assert "not auth" in done.stderr


def test_passwords_are_on_no_command_line(running: Lab) -> None:
    """`mosquitto_sub` finds them in a file, as the page about the lab says."""
    secrets = running.root("mosquitto") / "run/secrets/lab"
    environment = {**os.environ, "XDG_CONFIG_HOME": str(secrets)}
    command = ["mosquitto_sub", "-p", str(running.port[1883]), "-t", "x", "-W", "5"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS)
    assert "not auth" not in done.stderr
    assert done.returncode == 27  # Timed out.


def test_the_server_tells_the_broker_what_happens(running: Lab, front: str) -> None:
    topics = [f"robotouille/v1/lab/{topic}" for topic in ("presence", "episodes/+/life")]
    words = [word for topic in topics for word in ("-t", topic)]
    command = ["mosquitto_sub", *options(running, "lab"), *words, "-W", str(SECONDS)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listener:
        assert listener.stdout is not None
        assert '"online"' in listener.stdout.readline()  # It is retained: they are heard from now.
        episode = asyncio.run(play(front, minted(running, "host"), "told"))
        events = []
        for line in listener.stdout:
            told = json.loads(line)
            if told.get("episode") == episode:
                events.append(told["event"])
            if events[-1:] == ["ended"]:
                listener.terminate()
    assert events == ["opened", "started", "ended"]


def test_mqtt_comes_through_caddy_too(running: Lab, front: str) -> None:
    client = pytest.importorskip("paho.mqtt.client", reason="needs the extra `mqtt`")
    found: list[bytes] = []
    subscriber = client.Client(client.CallbackAPIVersion.VERSION2, transport="websockets")
    subscriber.username_pw_set("lab", (running.folder / "lab/secrets/mqtt_lab").read_text())
    subscriber.tls_set(ca_certs=os.environ["SSL_CERT_FILE"])
    subscriber.ws_set_options(path="/mqtt")
    subscriber.on_message = lambda _client, _data, message: found.append(message.payload)
    subscriber.on_connect = lambda *_: subscriber.subscribe("robotouille/v1/lab/presence")
    subscriber.connect("localhost", running.port[443])
    eventually(lambda: subscriber.loop(0.1) or found)
    subscriber.disconnect()
    assert b'"online"' in found[0]


# What goes wrong


def test_the_broker_takes_no_passwords_that_are_gone() -> None:
    with lab("mosquitto") as made:
        made.stop("mosquitto")
        (made.root("mosquitto") / "run/secrets/mqtt_passwords").unlink()
        made.start("mosquitto")
        assert made.await_end("mosquitto") != 0
        assert "password" in made.log("mosquitto")


def test_a_database_of_an_earlier_postgresql_is_told() -> None:
    with lab("postgres") as made:
        made.stop("postgres")
        version: Path = made.root("postgres") / "var/lib/postgresql/data/PG_VERSION"
        version.write_text("9.6\n")
        made.start("postgres")
        assert made.await_end("postgres") != 0
        assert "database files are incompatible with server" in made.log("postgres")
