"""The reference pages are current and complete."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from robotouille.errors import ProtocolError
from robotouille.planning.certifying import BUDGET
from robotouille.protocol import codec, messages
from robotouille_server import ServerSettings, peer
from robotouille_server.metrics import Metrics
from tests.docs.pages import DOCS, PAGES, ROOT, anchors, links, read, table, titled

MEANINGS = json.loads(read("messages.json"))
MODELS = {
    model.model_fields["type"].default: model
    for model in messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES
}
SOURCES = [
    path for folder in ("shared", "server", "client") for path in (ROOT / folder).rglob("*.py")
]


def test_generated_parts_are_current() -> None:
    program = [sys.executable, "tools/generate_docs.py", "--check"]
    result = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_every_message_has_an_example_and_every_field_a_meaning() -> None:
    assert MEANINGS["messages"].keys() == MODELS.keys()
    for name, model in MODELS.items():
        described = MEANINGS["messages"][name]["fields"].keys()
        assert described == model.model_fields.keys() - {"type", "ref"}, name
    for name, words in MEANINGS["parts"].items():
        assert words.keys() == getattr(messages, name).model_fields.keys()


@pytest.mark.parametrize("name", MODELS)
def test_examples_are_messages(name: str) -> None:
    example = MEANINGS["messages"][name]["example"]
    payload = json.dumps(example)
    if MODELS[name] in messages.CLIENT_MESSAGES:
        message = codec.JSON.decode_client(payload)
    else:
        message = codec.JSON.decode_server(payload)
    assert type(message) is MODELS[name]
    assert json.loads(codec.JSON.encode(message)) == json.loads(payload)


def test_every_error_code_is_documented() -> None:
    raised = {messages.Rejected.model_fields["code"].default}
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        raised.update(re.findall(r"ProtocolError\(\s*\"([a-z]+/[a-z-]+)\"", text))
        raised.update(re.findall(r"(?:code|_code)=\"([a-z]+/[a-z-]+)\"", text))
    documented = [row[0] for row in table("protocol.md", "Errors")]
    assert sorted(documented) == sorted(raised)


def test_an_error_carries_its_code() -> None:
    with pytest.raises(ProtocolError) as caught:
        codec.JSON.decode_client('{"type": "zap"}')
    assert caught.value.code == "message/unknown-type"


def test_limits_are_those_of_the_code() -> None:
    limits = {row[0]: row[1] for row in table("protocol.md", "Limits")}
    kib = 1024
    assert limits["a client's message"] == f"{codec.MAX_CLIENT_BYTES // kib} KiB"
    assert limits["a server's message"] == f"{codec.MAX_SERVER_BYTES // kib**2} MiB"
    assert limits["unread bytes"] == f"{peer.MAX_UNSENT // kib} KiB"
    assert f"{peer.MAX_HELD // kib**2} MiB" in " ".join(limits)
    defaults = ServerSettings()
    assert limits["connections (`max_connections`)"] == f"{defaults.max_connections:,}"
    assert str(int(defaults.messages_per_second)) in " ".join(limits.values())


def test_budgets_are_those_of_the_code() -> None:
    one, two, three, four = (f"{BUDGET.for_seats(n).expansions:,}" for n in range(1, 5))
    page = read("certificates.md")
    assert f"`--expansions` ({one} if not given) and `--states` ({BUDGET.states:,})" in page
    assert f"{two} for two, {three} for three and {four} for four" in page
    assert f"with {BUDGET.states:,} states kept" in page


def test_every_decision_is_listed() -> None:
    listed = links(DOCS / "decisions" / "README.md")
    found = sorted(path.name for path in (DOCS / "decisions").glob("0*.md"))
    assert listed == found


def test_every_page_is_listed() -> None:
    listed = {link.partition("#")[0] for link in links(DOCS / "README.md")}
    assert {path.name for path in DOCS.glob("*.md")} - {"README.md"} <= listed


def test_every_command_is_documented() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name in project["project"]["scripts"]:
        assert f"`{name}" in read("settings.md")


def test_every_metric_is_documented() -> None:
    documented = {row[0] for row in table("settings.md", "Metrics")}
    exposed = {
        family.name + ("_total" if family.type == "counter" else "")
        for family in Metrics().registry.collect()
    }
    assert documented == exposed


def test_the_settings_file_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "server.toml"
    file.write_text(titled("settings.md", "server.toml"), encoding="utf-8")
    monkeypatch.setenv("ROBOTOUILLE_STEP_RATE", "9")
    settings = ServerSettings(config=file, max_steps=7)
    assert (settings.mode, settings.step_rate, settings.max_steps) == ("realtime", 9, 7)


def test_asyncapi_references_resolve() -> None:
    document = json.loads(read("asyncapi.json"))
    references = re.findall(r'"\$ref": "#/([^"]+)"', read("asyncapi.json"))
    assert references
    for reference in references:
        target = document
        for part in reference.split("/"):
            target = target[part]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_links_resolve(page: Path) -> None:
    for link in links(page):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link
