"""Services of `docker-compose.yml`, run as processes with their own files."""

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
    """Run all services except Grafana, which Debian does not package."""
    with lab(*SERVICES) as made:
        yield made


def eventually(find: Callable[[], Any]) -> Any:
    """Call a function until its result is true, and return the result."""
    end = time.monotonic() + SECONDS
    while not (found := find()):
        assert time.monotonic() < end, f"nothing found in {SECONDS} s"
        time.sleep(0.1)
    return found


def test_all_services_are_healthy(running: Lab) -> None:
    assert all(running.health(name) for name in SERVICES)
    others = {
        name for name, service in running.services.items() if service.get("profiles") != ["cluster"]
    }
    assert others - set(SERVICES) == {"grafana"}


def test_all_hosts_and_ports_in_the_files_are_used(running: Lab) -> None:
    assert running.used == running.hosts.keys() - {"127.0.0.1:8766"}


def test_health_check_detects_a_stopped_service() -> None:
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


def test_prometheus_scrapes_the_server_and_loads_the_rules(running: Lab) -> None:
    def scraped() -> bool:
        return any(
            target["health"] == "up" for target in prometheus(running, "targets")["activeTargets"]
        )

    eventually(scraped)
    (group,) = prometheus(running, "rules")["groups"]
    assert [rule["name"] for rule in group["rules"]] == [rule["alert"] for rule in RULES]
    assert eventually(lambda: prometheus(running, "query", query="robotouille_episodes")["result"])


def test_queries_of_all_panels_are_valid(running: Lab) -> None:
    for target in TARGETS:
        if "expr" in target:
            prometheus(running, "query", query=target["expr"])


# Caddy


@pytest.fixture
def front(running: Lab, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the public address. Clients trust Caddy's own authority."""
    authority = running.folder / "lab/data/caddy/caddy/pki/authorities/local/root.crt"
    monkeypatch.setenv("SSL_CERT_FILE", str(eventually(lambda: authority.is_file() and authority)))
    return f"localhost:{running.port[443]}"


def mint_token(running: Lab, role: str) -> str:
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
    """Play an episode with random actions over TLS, and return its id."""
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


def test_caddy_forwards_the_game_with_tls(running: Lab, front: str) -> None:
    assert asyncio.run(role(front)) == "player"
    assert status(f"https://{front}/healthz") == 200
    assert status(f"https://{front}/metrics") == 404
    assert status(f"https://{front}/grafana/") == 502
    plain = HTTPConnection("localhost", running.port[80], timeout=SECONDS)
    plain.request("GET", "/healthz")
    assert plain.getresponse().getheader("Location") == "https://localhost/healthz"
    plain.close()


def test_ended_episode_appears_in_the_catalogue(running: Lab, front: str) -> None:
    episode = asyncio.run(play(front, mint_token(running, "host"), "a'b"))
    query = (
        "SELECT l.value FROM episodes e JOIN labels l ON l.episode_id = e.id "
        f"WHERE e.episode = '{episode}'"
    )
    assert eventually(lambda: running.ask(query).stdout) == "a'b\n"


ON_THE_SERVER = (
    "SELECT lo_import('/etc/passwd')",
    "SELECT pg_reload_conf()",
    "SELECT pg_read_file('/etc/passwd')",
    "SELECT pg_ls_dir('/')",
    "COPY (SELECT 1) TO PROGRAM 'true'",
    "CREATE ROLE x",
)
FILLING = ("SELECT lo_create(1)", "CREATE TEMPORARY TABLE x ()")


@pytest.mark.parametrize(
    ("user", "changes"),
    [("robotouille", ON_THE_SERVER), ("reader", (*ON_THE_SERVER, *FILLING))],
)
def test_roles_cannot_use_the_database_server(
    running: Lab, user: str, changes: tuple[str, ...]
) -> None:
    assert running.ask("SHOW is_superuser", user).stdout == "off\n"
    for change in changes:
        refusal = running.ask(f"SET TRANSACTION READ WRITE; {change}", user).stderr
        assert "permission denied" in refusal or "must be" in refusal, change


def test_catalogue_user_cannot_write(running: Lab) -> None:
    for target in TARGETS:
        if "rawSql" in target:
            done = running.ask(target["rawSql"])
            assert done.returncode == 0, done.stderr
    for change in ("DELETE FROM episodes", "CREATE TABLE x ()"):
        assert "permission denied" in running.ask(f"SET TRANSACTION READ WRITE; {change}").stderr


def test_operator_page_requires_a_token(running: Lab) -> None:
    url = f"http://127.0.0.1:{running.port[8766]}"
    assert status(f"{url}/") == 200
    assert status(f"{url}/api/overview") == 401
    header = {"Authorization": f"Bearer {mint_token(running, 'operator')}"}
    with urlopen(Request(f"{url}/api/overview", headers=header), timeout=SECONDS) as answer:
        assert answer.status == 200


# Mosquitto


def options(running: Lab, user: str) -> list[str]:
    password = (running.folder / f"lab/secrets/mqtt_{user}").read_text()
    return ["-p", str(running.port[1883]), "-u", user, "-P", password]


def received(running: Lab, user: str, topic: str, *words: str, seconds: int = 5) -> str:
    command = ["mosquitto_sub", *options(running, user), "-t", topic, "-W", str(seconds), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS).stdout


def publish(running: Lab, user: str, topic: str, text: str) -> None:
    command = ["mosquitto_pub", *options(running, user), "-t", topic, "-m", text, "-q", "1", "-r"]
    subprocess.run(command, capture_output=True, timeout=SECONDS)


def test_users_are_limited_to_their_topics(running: Lab) -> None:
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
        lines = received(running, user, "#", seconds=3).splitlines()
        assert {line for line in lines if line.endswith(("0", "1", "2", "3"))} == expected, user
    publish(running, "server", topics[0], "")
    publish(running, "lab", topics[1], "")
    publish(running, "server", topics[2], "")


def test_broker_requires_a_password(running: Lab) -> None:
    for words in ([], ["-u", "lab"], ["-u", "lab", "-P", "wrong"], ["-u", "nobody", "-P", "x"]):
        command = ["mosquitto_sub", "-p", str(running.port[1883]), *words, "-t", "#", "-W", "5"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
        assert done.returncode == 5, done.stderr
        assert "not auth" in done.stderr


def test_mosquitto_sub_reads_the_password_from_a_file(running: Lab) -> None:
    # A password on the command line would be visible to all users of the machine.
    secrets = running.root("mosquitto") / "run/secrets/lab"
    environment = {**os.environ, "XDG_CONFIG_HOME": str(secrets)}
    command = ["mosquitto_sub", "-p", str(running.port[1883]), "-t", "x", "-W", "5"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS)
    assert "not auth" not in done.stderr
    assert done.returncode == 27  # Timed out.


def test_server_publishes_events(running: Lab, front: str) -> None:
    topics = [f"robotouille/v1/lab/{topic}" for topic in ("presence", "episodes/+/life")]
    words = [word for topic in topics for word in ("-t", topic)]
    command = ["mosquitto_sub", *options(running, "lab"), *words, "-W", str(SECONDS)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listener:
        assert listener.stdout is not None
        assert (
            '"online"' in listener.stdout.readline()
        )  # The message is retained, so the subscription is active.
        episode = asyncio.run(play(front, mint_token(running, "host"), "x"))
        events = []
        for line in listener.stdout:
            message = json.loads(line)
            if message.get("episode") == episode:
                events.append(message["event"])
            if events[-1:] == ["ended"]:
                listener.terminate()
    assert events == ["opened", "started", "ended"]


def test_caddy_forwards_mqtt(running: Lab, front: str) -> None:
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


# Faults


def test_broker_does_not_start_without_its_passwords() -> None:
    with lab("mosquitto") as made:
        made.stop("mosquitto")
        (made.root("mosquitto") / "run/secrets/mqtt_passwords").unlink()
        made.start("mosquitto")
        assert made.await_end("mosquitto") != 0
        assert "password" in made.log("mosquitto")


def test_database_of_an_older_postgresql_is_reported() -> None:
    with lab("postgres") as made:
        made.stop("postgres")
        version: Path = made.root("postgres") / "var/lib/postgresql/data/PG_VERSION"
        version.write_text("9.6\n")
        made.start("postgres")
        assert made.await_end("postgres") != 0
        assert "database files are incompatible with server" in made.log("postgres")
