"""Where the broker is and how one proves who one is, from settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import RobotouilleError
from robotouille_server import ServerSettings
from robotouille_server.mqtt.address import BrokerAddress, server_name
from robotouille_server.runtime.workers import WorkerSlot


def address(**settings: Any) -> BrokerAddress:
    return BrokerAddress.from_settings(ServerSettings(**settings))


@pytest.mark.parametrize(
    ("url", "host", "port", "user"),
    [
        ("mqtt://broker", "broker", 1883, None),
        ("mqtt://kit%40chen@10.0.0.1:2000/", "10.0.0.1", 2000, "kit@chen"),
        ("mqtt://[::1]", "::1", 1883, None),
        ("mqtts://broker", "broker", 8883, None),
    ],
)
def test_a_url_names_host_port_and_user(url: str, host: str, port: int, user: str | None) -> None:
    found = address(mqtt=url)
    assert (found.host, found.port, found.user) == (host, port, user)
    assert (found.tls is not None) == url.startswith("mqtts")


@pytest.mark.parametrize(
    "url", ["broker:1883", "http://broker", "mqtt://", "mqtt://b/topic", "mqtt://b:x", "mqtt://b?a"]
)
def test_anything_else_is_refused(url: str) -> None:
    with pytest.raises(RobotouilleError, match="--mqtt"):
        address(mqtt=url)


@pytest.mark.parametrize("host", ["a..b", "a" * 64, "h h", "\ud800", "a" + "\u3002" * 2])
def test_what_can_be_no_host_is_refused_at_the_start(host: str) -> None:
    with pytest.raises(RobotouilleError, match="is no name or address"):
        address(mqtt=f"mqtt://{host}")


def test_a_password_in_the_url_is_refused_with_what_to_do_and_not_repeated() -> None:
    with pytest.raises(RobotouilleError, match="--mqtt-password-file") as refused:
        address(mqtt="mqtt://me:geheim@broker")
    assert "geheim" not in str(refused.value)


def test_the_password_is_in_a_file_that_nobody_else_may_use(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("geheim\n")
    file.chmod(0o600)
    found = address(mqtt="mqtt://me@broker", mqtt_password_file=file)
    assert found.password == "geheim"
    assert "geheim" not in repr(found) + str(found)
    file.chmod(0o644)
    with pytest.raises(RobotouilleError, match="chmod 600"):
        address(mqtt="mqtt://me@broker", mqtt_password_file=file)
    with pytest.raises(RobotouilleError, match="is not there"):
        address(mqtt="mqtt://me@broker", mqtt_password_file=tmp_path / "none")


def test_or_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTOUILLE_MQTT_PASSWORD", "geheim")
    assert address(mqtt="mqtt://me@broker").password == "geheim"


def test_a_certificate_authority_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(RobotouilleError, match=r"--mqtt-ca: .*none\.pem"):
        address(mqtt="mqtts://broker", mqtt_ca=tmp_path / "none.pem")


def test_each_worker_has_a_name_of_its_own() -> None:
    settings = ServerSettings(mqtt_name="lab")
    assert server_name(settings, WorkerSlot(), 8765) == "lab"
    assert server_name(settings, WorkerSlot(index=1, count=2), 8765) == "lab-w1"
    assert server_name(ServerSettings(), WorkerSlot(), 8765).endswith("-8765")


@pytest.mark.parametrize("name", ["a/b", "+", "a#", "a b", "$SYS", "x" * 65])
def test_a_name_that_cannot_be_a_level_of_a_topic_is_refused(name: str) -> None:
    with pytest.raises(RobotouilleError, match="--mqtt-name"):
        server_name(ServerSettings(mqtt_name=name), WorkerSlot(), 8765)
