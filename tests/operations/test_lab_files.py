"""The files of the lab in `docker-compose.yml` are valid, consistent and documented."""

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
from tests.support.compose import COMPOSE, compose
from tests.support.metrics import node_metrics
from tests.support.pages import read
from tests.support.sources import ROOT

LAB = ROOT / "lab"
SERVICES: dict[str, dict[str, Any]] = compose()["services"]
MAIN = {name: service for name, service in SERVICES.items() if "profiles" not in service}
NODES = ("server", "node2", "node3")
SECONDS = {"s": 1, "m": 60}


def seconds(text: str) -> int:
    return int(text[:-1]) * SECONDS[text[-1]]


@pytest.mark.process
@pytest.mark.skipif(
    importlib.util.find_spec("check_jsonschema") is None, reason="check-jsonschema is not installed"
)
def test_file_follows_the_compose_specification() -> None:
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec"]
    done = subprocess.run([*command, str(COMPOSE)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout


def test_default_profile_contains_only_the_server() -> None:
    assert list(MAIN) == ["server"]
    others = [SERVICES[name]["profiles"] for name in SERVICES.keys() - MAIN.keys()]
    assert all(profiles in (["lab"], ["cluster"]) for profiles in others)
    assert "depends_on" not in SERVICES["server"]


def test_server_starts_without_secrets() -> None:
    content = compose()
    for name in SERVICES["server"]["secrets"]:
        assert (ROOT / content["secrets"][name]["file"]).is_file(), name
    for volume in SERVICES["server"]["volumes"]:
        assert volume.partition(":")[0] in content["volumes"]


@pytest.mark.parametrize("name", SERVICES)
def test_service_is_pinned_monitored_and_confined(name: str) -> None:
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


def test_only_caddy_is_reachable_from_other_machines() -> None:
    ports = {name: service["ports"] for name, service in SERVICES.items() if "ports" in service}
    assert set(ports) == {*NODES, "caddy"}
    assert all(port.startswith("127.0.0.1:") for name in NODES for port in ports[name])
    assert ports["caddy"] == ["80:80", "443:443"]
    networks = compose()["networks"]
    outside = {name for name, network in networks.items() if not network.get("internal")}
    assert outside == {"front"}
    assert {name for name, one in SERVICES.items() if "front" in one["networks"]} == set(ports)


def test_services_share_only_the_networks_they_need() -> None:
    shared = {
        network: {name for name, service in SERVICES.items() if network in service["networks"]}
        for network in compose()["networks"]
    }
    assert shared == {
        "front": {*NODES, "caddy"},
        "messages": {*NODES, "mosquitto", "caddy"},
        "tables": {"postgres", "catalogue", "grafana"},
        "measures": {*NODES, "prometheus", "grafana"},
        "pages": {"grafana", "caddy"},
        "cluster": {*NODES, "nats1", "nats2", "nats3"},
    }


@pytest.mark.parametrize("name", NODES)
def test_stop_grace_period_exceeds_drain_seconds(name: str) -> None:
    server = SERVICES[name]
    drain = float(server["environment"]["ROBOTOUILLE_DRAIN_SECONDS"])
    assert seconds(server["stop_grace_period"]) > drain + 10


@pytest.mark.parametrize("name", NODES)
def test_settings_of_the_server_exist(name: str) -> None:
    names = {name.removeprefix("ROBOTOUILLE_").lower() for name in SERVICES[name]["environment"]}
    assert names <= ServerSettings.model_fields.keys()


def test_nodes_differ_only_in_name_address_and_folders() -> None:
    for name in NODES:
        environment = SERVICES[name]["environment"]
        port = SERVICES[name]["ports"][0].split(":")[1]
        assert environment["ROBOTOUILLE_CLUSTER_URL"] == f"ws://127.0.0.1:{port}"
    for setting in SERVICES["server"]["environment"]:
        values = [SERVICES[name]["environment"][setting] for name in NODES]
        unique = setting in ("ROBOTOUILLE_CLUSTER_URL", "ROBOTOUILLE_MQTT_NAME")
        assert len(set(values)) == (len(NODES) if unique else 1), setting
    volumes = [volume for name in NODES for volume in SERVICES[name]["volumes"]]
    assert len({volume.partition(":")[0] for volume in volumes}) == len(volumes)


def test_mounted_files_exist() -> None:
    for name, service in SERVICES.items():
        for volume in service.get("volumes", []):
            source, _, rest = volume.partition(":")
            if source.startswith("./lab/") and not source.startswith("./lab/data/"):
                assert rest.endswith(":ro"), (name, volume)
                assert (ROOT / source).exists(), (name, volume)


def test_named_secrets_are_mounted() -> None:
    """Checks the environment, the configuration files and the scripts."""
    files = {
        "mosquitto": ["mosquitto.conf"],
        **{f"nats{number}": ["nats.conf"] for number in (1, 2, 3)},
        "postgres": ["roles.sh"],
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


# Monitoring

RULES = yaml.safe_load((LAB / "robotouille.rules.yml").read_text(encoding="utf-8"))
DASHBOARD = json.loads((LAB / "grafana/dashboards/robotouille.json").read_text(encoding="utf-8"))
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]


def counted() -> set[str]:
    """Return the names on the server's metrics page."""
    page = node_metrics().page().decode()
    samples = set(re.findall(r"^(robotouille_\w+)", page, re.MULTILINE))
    families = set(re.findall(r"^# TYPE (robotouille_\w+) (?:counter|gauge)", page, re.MULTILINE))
    return samples | families


def named(expression: str) -> set[str]:
    return set(re.findall(r"\brobotouille_\w+", expression))


def documented(name: str) -> bool:
    return f"`{name.removesuffix('_bucket')}`" in read("settings.md")


def test_rules_use_existing_metrics() -> None:
    (group,) = RULES["groups"]
    for rule in group["rules"]:
        assert named(rule["expr"]) <= counted(), rule["alert"]
        assert all(map(documented, named(rule["expr"])))
        assert rule["labels"]["severity"] in ("warning", "critical")
        assert rule["annotations"]["summary"]


def test_guide_lists_all_alerts() -> None:
    (group,) = RULES["groups"]
    listed = set(
        re.findall(r"^\| `(Robotouille\w+)` \|", read("operate_a_server.md"), re.MULTILINE)
    )
    assert listed == {rule["alert"] for rule in group["rules"]}


def test_dashboard_uses_existing_metrics() -> None:
    expressions = [
        target["expr"] for panel in PANELS for target in panel["targets"] if "expr" in target
    ]
    shown = {name for expression in expressions for name in named(expression)}
    assert shown <= counted()
    assert all(map(documented, shown))
    assert {"robotouille_steps_total", "robotouille_disk_free_bytes"} <= shown


@pytest.mark.process
@pytest.mark.skipif(not shutil.which("promtool"), reason="Prometheus is not installed")
def test_prometheus_accepts_its_files() -> None:
    command = ["promtool", "check", "config", str(LAB / "prometheus.yml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(RULES['groups'][0]['rules'])} rules found" in done.stdout
