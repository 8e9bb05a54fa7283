"""The lab of `docker-compose.yml`: its files are valid, fit each other, and are as docs say."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import subprocess
import sys
from typing import Any

import pytest
import yaml

from robotouille_server import ServerSettings
from robotouille_server.runtime.metrics import Metrics
from tests.support.compose import COMPOSE, compose
from tests.support.pages import read
from tests.support.sources import ROOT

LAB = ROOT / "lab"
SERVICES: dict[str, dict[str, Any]] = compose()["services"]
MAIN = {name: service for name, service in SERVICES.items() if "profiles" not in service}
SECONDS = {"s": 1, "m": 60}


def seconds(text: str) -> int:
    return int(text[:-1]) * SECONDS[text[-1]]


@pytest.mark.process
@pytest.mark.skipif(
    importlib.util.find_spec("check_jsonschema") is None, reason="check-jsonschema is not installed"
)
def test_the_file_follows_the_specification_of_compose() -> None:
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec"]
    done = subprocess.run([*command, str(COMPOSE)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout


def test_without_a_profile_the_server_is_alone() -> None:
    assert list(MAIN) == ["server"]
    assert all(SERVICES[name]["profiles"] == ["lab"] for name in SERVICES.keys() - MAIN.keys())
    assert "depends_on" not in SERVICES["server"]


def test_it_starts_from_a_clone_in_which_no_secret_was_made() -> None:
    content = compose()
    for name in SERVICES["server"]["secrets"]:
        assert (ROOT / content["secrets"][name]["file"]).is_file(), name
    for volume in SERVICES["server"]["volumes"]:
        assert volume.partition(":")[0] in content["volumes"]


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_is_pinned_watched_and_confined(name: str) -> None:
    service = SERVICES[name]
    if service["image"] != "robotouille":
        assert re.fullmatch(r"[\w/.-]+:v?\d+\.\d+(\.\d+)?[\w.-]*", service["image"])
    assert service["healthcheck"]["test"][0] == "CMD"
    assert {"interval", "timeout", "retries", "start_period"} <= service["healthcheck"].keys()
    assert service["restart"] == "unless-stopped"
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert not service["user"].startswith(("0", "root"))
    assert "max-size" in service["logging"]["options"]
    assert seconds(service["stop_grace_period"]) >= 15


def test_only_caddy_and_on_loopback_the_server_can_be_reached_from_outside() -> None:
    ports = {name: service["ports"] for name, service in SERVICES.items() if "ports" in service}
    assert set(ports) == {"server", "caddy"}
    assert all(port.startswith("127.0.0.1:") for port in ports["server"])
    assert ports["caddy"] == ["80:80", "443:443"]
    networks = compose()["networks"]
    outside = {name for name, network in networks.items() if not network.get("internal")}
    assert outside == {"front"}
    assert {name for name, one in SERVICES.items() if "front" in one["networks"]} == set(ports)


def test_who_needs_each_other_shares_a_network_and_nobody_else_does() -> None:
    shared = {
        network: {name for name, service in SERVICES.items() if network in service["networks"]}
        for network in compose()["networks"]
    }
    assert shared == {
        "front": {"server", "caddy"},
        "messages": {"server", "mosquitto", "caddy"},
        "tables": {"postgres", "catalogue", "grafana"},
        "measures": {"server", "prometheus", "grafana"},
        "pages": {"grafana", "caddy"},
    }


def test_the_server_has_more_time_to_stop_than_it_asks_for() -> None:
    server = SERVICES["server"]
    drain = float(server["environment"]["ROBOTOUILLE_DRAIN_SECONDS"])
    assert seconds(server["stop_grace_period"]) > drain + 10


def test_the_servers_settings_are_settings() -> None:
    names = {
        name.removeprefix("ROBOTOUILLE_").lower() for name in SERVICES["server"]["environment"]
    }
    assert names <= ServerSettings.model_fields.keys()


def test_files_that_are_mounted_are_there() -> None:
    for name, service in SERVICES.items():
        for volume in service.get("volumes", []):
            source, _, rest = volume.partition(":")
            if source.startswith("./lab/") and not source.startswith("./lab/data/"):
                assert rest.endswith(":ro"), (name, volume)
                assert (ROOT / source).exists(), (name, volume)


def test_paths_of_secrets_that_files_name_are_mounted() -> None:
    """In the environment, in what is configured, and in what the scripts read."""
    files = {
        "mosquitto": ["mosquitto.conf"],
        "postgres": ["reader.sh"],
        "grafana": ["grafana/provisioning/datasources/lab.yml"],
    }
    for name, service in SERVICES.items():
        text = json.dumps(service.get("environment", {}))
        text += "".join((LAB / file).read_text() for file in files.get(name, []))
        named = set(re.findall(r"/run/secrets/([\w/]+)", text)) - {"health"}
        assert named <= {_target(each) for each in service.get("secrets", [])}, name


def _target(secret: Any) -> str:
    if isinstance(secret, str):
        return secret
    return str(secret["target"]).removeprefix("/run/secrets/")


# What is watched

RULES = yaml.safe_load((LAB / "robotouille.rules.yml").read_text(encoding="utf-8"))
DASHBOARD = json.loads((LAB / "grafana/dashboards/robotouille.json").read_text(encoding="utf-8"))
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]


def counted() -> set[str]:
    """What the server's page for Prometheus has."""
    page = Metrics().page().decode()
    samples = set(re.findall(r"^(robotouille_\w+)", page, re.MULTILINE))
    families = set(re.findall(r"^# TYPE (robotouille_\w+) (?:counter|gauge)", page, re.MULTILINE))
    return samples | families


def named(expression: str) -> set[str]:
    return set(re.findall(r"\brobotouille_\w+", expression))


def documented(name: str) -> bool:
    return f"`{name.removesuffix('_bucket')}`" in read("settings.md")


def test_rules_are_about_what_the_server_counts() -> None:
    (group,) = RULES["groups"]
    for rule in group["rules"]:
        assert named(rule["expr"]) <= counted(), rule["alert"]
        assert all(map(documented, named(rule["expr"])))
        assert rule["labels"]["severity"] in ("warning", "critical")
        assert rule["annotations"]["summary"]


def test_the_guide_has_all_rules() -> None:
    (group,) = RULES["groups"]
    told = set(re.findall(r"^\| `(Robotouille\w+)` \|", read("operations.md"), re.MULTILINE))
    assert told == {rule["alert"] for rule in group["rules"]}


def test_the_dashboard_shows_what_the_server_counts() -> None:
    expressions = [
        target["expr"] for panel in PANELS for target in panel["targets"] if "expr" in target
    ]
    shown = {name for expression in expressions for name in named(expression)}
    assert shown <= counted()
    assert all(map(documented, shown))
    assert {"robotouille_steps_total", "robotouille_disk_free_bytes"} <= shown


def test_the_dashboard_is_whole() -> None:
    sources = yaml.safe_load((LAB / "grafana/provisioning/datasources/lab.yml").read_text())
    known = {(source["uid"], source["type"]) for source in sources["datasources"]}
    for panel in PANELS:
        assert (panel["datasource"]["uid"], panel["datasource"]["type"]) in known
        assert panel["title"]
        assert all(target["datasource"] == panel["datasource"] for target in panel["targets"])
    numbers = [panel["id"] for panel in DASHBOARD["panels"]]
    assert len(numbers) == len(set(numbers))
    for one in DASHBOARD["panels"]:
        for other in DASHBOARD["panels"]:
            assert one is other or not _overlap(one["gridPos"], other["gridPos"])


def _overlap(one: dict[str, int], other: dict[str, int]) -> bool:
    return (
        one["x"] < other["x"] + other["w"]
        and other["x"] < one["x"] + one["w"]
        and one["y"] < other["y"] + other["h"]
        and other["y"] < one["y"] + one["h"]
    )


@pytest.mark.process
@pytest.mark.skipif(not shutil.which("promtool"), reason="Prometheus is not installed")
def test_prometheus_takes_its_files() -> None:
    command = ["promtool", "check", "config", str(LAB / "prometheus.yml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(RULES['groups'][0]['rules'])} rules found" in done.stdout
