"""The manifests of `lab/kubernetes` are consistent with each other, the image and the server."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import Any

import pytest
import yaml

from robotouille_server import ServerSettings
from tests.support.sources import ROOT

FOLDER = ROOT / "lab/kubernetes"
TEXT = (FOLDER / "robotouille.yaml").read_text(encoding="utf-8")
NATS = yaml.safe_load((FOLDER / "nats_values.yaml").read_text(encoding="utf-8"))
DOCKER = (ROOT / "Dockerfile").read_text(encoding="utf-8")
OBJECTS: dict[str, dict[str, dict[str, Any]]] = defaultdict(dict)
for _each in yaml.safe_load_all(TEXT):
    if _each is not None:
        OBJECTS[_each["kind"]][_each["metadata"]["name"]] = _each
NODES = OBJECTS["StatefulSet"]["robotouille"]["spec"]
POD = NODES["template"]["spec"]
(SERVER,) = POD["containers"]
ENVIRONMENT = {each["name"]: each.get("value") for each in SERVER["env"]}
LABELS = NODES["template"]["metadata"]["labels"]
NAMES = [f"robotouille-{number}" for number in range(NODES["replicas"])]


def test_objects_have_the_expected_kinds() -> None:
    assert {kind: len(found) for kind, found in OBJECTS.items()} == {
        "StatefulSet": 1,
        "PodDisruptionBudget": 1,
        "Service": 2 + len(NAMES),
        "Ingress": 1,
    }
    assert all(each["apiVersion"] for found in OBJECTS.values() for each in found.values())


def test_selectors_match_the_nodes() -> None:
    services = OBJECTS["Service"]
    assert NODES["selector"]["matchLabels"] == LABELS
    assert (
        OBJECTS["PodDisruptionBudget"]["robotouille"]["spec"]["selector"]["matchLabels"] == LABELS
    )
    assert services[NODES["serviceName"]]["spec"] == {
        "clusterIP": "None",
        "selector": LABELS,
        "ports": [{"name": "clients", "port": 8765}],
    }
    assert services["robotouille"]["spec"]["selector"] == LABELS
    for name in NAMES:
        label = {"statefulset.kubernetes.io/pod-name": name}
        assert services[name]["spec"]["selector"] == label


def test_ingress_reaches_each_node_at_its_address() -> None:
    spec = OBJECTS["Ingress"]["robotouille"]["spec"]
    (rule,) = spec["rules"]
    assert spec["tls"][0]["hosts"] == [rule["host"]]
    reached = {
        f"wss://{rule['host']}{path['path']}": path["backend"]["service"]["name"]
        for path in rule["http"]["paths"]
    }
    url = ENVIRONMENT["ROBOTOUILLE_CLUSTER_URL"]
    nodes = {url.replace("$(POD_NAME)", name): name for name in NAMES}
    assert reached == {**nodes, f"wss://{rule['host']}/": "robotouille"}
    assert all(path["pathType"] == "Exact" for path in rule["http"]["paths"])


def test_settings_of_the_nodes_are_valid() -> None:
    given = {
        name.removeprefix("ROBOTOUILLE_").lower(): value
        for name, value in ENVIRONMENT.items()
        if name.startswith("ROBOTOUILLE_")
    }
    settings = ServerSettings(**given)
    assert settings.require_token
    assert settings.keys == settings.state_folder / "keys.json"


def test_nodes_have_time_to_drain() -> None:
    pause = SERVER["lifecycle"]["preStop"]["sleep"]["seconds"]
    drain = float(ENVIRONMENT["ROBOTOUILLE_DRAIN_SECONDS"])
    assert POD["terminationGracePeriodSeconds"] >= pause + drain + 10


@pytest.mark.parametrize(
    ("probe", "path"), [("startupProbe", "/healthz"), ("readinessProbe", "/readyz")]
)
def test_probes_use_pages_of_the_server(probe: str, path: str) -> None:
    assert SERVER[probe]["httpGet"] == {"path": path, "port": "clients"}
    assert {"name": "clients", "containerPort": 8765} in SERVER["ports"]


def test_nodes_are_confined_and_run_as_the_user_of_the_image() -> None:
    ((user, group),) = re.findall(r"^USER (\d+):(\d+)$", DOCKER, re.MULTILINE)
    context = POD["securityContext"]
    assert (context["runAsUser"], context["runAsGroup"]) == (int(user), int(group))
    assert context["fsGroup"] == int(group)
    assert context["runAsNonRoot"]
    assert SERVER["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert POD["automountServiceAccountToken"] is False


def test_services_set_no_settings() -> None:
    """Kubernetes would set ROBOTOUILLE_PORT to the address of the service `robotouille`."""
    assert POD["enableServiceLinks"] is False


def test_mounted_files_exist() -> None:
    mounts = {each["mountPath"]: each["name"] for each in SERVER["volumeMounts"]}
    claims = {each["metadata"]["name"] for each in NODES["volumeClaimTemplates"]}
    assert set(mounts.values()) == {each["name"] for each in POD["volumes"]} | claims
    assert ENVIRONMENT["ROBOTOUILLE_RECORDINGS"].startswith("/data/") and mounts["/data"] in claims
    made = set(re.findall(r"--from-literal=(\w+)=", TEXT))
    files = {name for value in ENVIRONMENT.values() for name in _secrets(str(value))}
    assert files == made
    key = NATS["container"]["env"]["SERVER_PASSWORD"]["valueFrom"]["secretKeyRef"]
    assert key["name"] == POD["volumes"][0]["secret"]["secretName"] == "robotouille"
    assert key["key"] in made


def _secrets(value: str) -> list[str]:
    return re.findall(r"^/run/secrets/robotouille/(\w+)$", value)


def test_nats_has_a_quorum() -> None:
    assert NATS["config"]["cluster"] == {"enabled": True, "replicas": 3}
    assert NATS["config"]["jetstream"]["fileStore"]["pvc"]["enabled"]
