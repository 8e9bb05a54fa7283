"""The reference pages are current and complete."""

import ast
import importlib
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path

import pytest
import typer
from pydantic import SecretStr
from pydantic.json_schema import models_json_schema
from tools.message_examples import EXAMPLES

from robotouille.certification.certifying import BUDGET
from robotouille.episode import Absence, Controller, PauseReason
from robotouille.episode.quota import SEAT_QUOTA_BYTES
from robotouille.protocol import codec, messages
from robotouille.replay.compression import BLOCK
from robotouille_client.sansio import attempts as backoff
from robotouille_server import ServerSettings
from robotouille_server.auth.roles import Role
from robotouille_server.auth.visitors import WRONG_CODES_A_MINUTE
from robotouille_server.cli import SECRET
from robotouille_server.rooms import lobby, room_factory
from robotouille_server.rooms.publishing import broadcaster
from robotouille_server.runtime import budgets as message_budget
from robotouille_server.transport import peer
from robotouille_server.transport.connection import FRAMES_A_SECOND, FRAMES_BURST, MAX_EXCESS
from tests.support.metrics import node_metrics
from tests.support.pages import DOCS, PAGES, anchors, links, read, table, titled
from tests.support.sources import ROOT

MODELS = {
    model.model_fields["type"].default: model
    for model in messages.CLIENT_MESSAGES + messages.SERVER_MESSAGES
}
SOURCES = [
    path for folder in ("shared", "server", "client") for path in (ROOT / folder).rglob("*.py")
]


@pytest.mark.process
def test_generated_parts_are_current() -> None:
    program = [sys.executable, "tools/generate_docs.py", "--check"]
    result = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_every_field_has_a_description() -> None:
    _, schemas = models_json_schema([(model, "validation") for model in MODELS.values()])
    missing = [
        f"{name}.{field}"
        for name, schema in schemas["$defs"].items()
        for field, row in schema.get("properties", {}).items()
        if field != "type" and not row.get("description")
    ]
    assert missing == []


@pytest.mark.parametrize("name", MODELS)
def test_examples_are_messages(name: str) -> None:
    payload = json.dumps(EXAMPLES[name])
    if MODELS[name] in messages.CLIENT_MESSAGES:
        message = codec.JSON.decode_client(payload)
    else:
        message = codec.JSON.decode_server(payload)
    assert type(message) is MODELS[name]
    assert json.loads(codec.JSON.encode(message)) == json.loads(payload)


FAMILIES = "action|auth|episode|message|protocol|rate|seat|server|session|state|task"
NO_CODES = {"robotouille/role", "robotouille/resume"}
OPERATORS = ROOT / "server/robotouille_server/operator"
"""Its HTTP API has codes of its own, in docs/operate_a_server.md."""


def strings(text: str) -> Iterable[str]:
    """All string literals of a source."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def codes_in_the_sources() -> set[str]:
    """Return the strings in the sources that look like error codes."""
    found: set[str] = set()
    for path in SOURCES:
        if path.is_relative_to(OPERATORS):
            continue
        text = path.read_text(encoding="utf-8")
        if re.search(rf"({FAMILIES})/[a-z-]+", text):
            found.update(s for s in strings(text) if re.fullmatch(rf"({FAMILIES})/[a-z-]+", s))
        found.update(re.findall(r"(?:ProtocolError|part)\(\s*\"([a-z]+/[a-z-]+)\"", text))
        found.update(re.findall(r"code(?:: str)? ?= ?\"([a-z]+/[a-z-]+)\"", text))
    return found - NO_CODES


def test_pages_install_from_a_clone() -> None:
    # No release is on an index, where the name could belong to a stranger.
    assert [page for page in PAGES if re.search(r"pip install '?robotouille\b", read(page))] == []


def test_every_error_code_is_documented() -> None:
    documented = [row[0] for row in table("protocol.md", "Errors")]
    assert sorted(documented) == sorted(codes_in_the_sources())


def test_every_farewell_is_documented() -> None:
    """The table has every code of `bye`, and whether the client may reconnect."""
    texts = [p.read_text(encoding="utf-8") for p in SOURCES if "robotouille_server" in p.parts]
    given = {code for text in texts for code in re.findall(r"\.close\(\s*\"([a-z/-]+)\"", text)}
    rows = {row[0]: row[2] for row in table("protocol.md", "When the server closes")}
    assert rows.keys() == given
    again = {"server/restart", "server/handover", "auth/silent", "rate/connections"}
    assert {code for code, retry in rows.items() if retry} == again


@pytest.mark.parametrize(("heading", "values"), [("Absence", Absence), ("Pauses", PauseReason)])
def test_every_rule_and_reason_is_documented(heading: str, values: type[StrEnum]) -> None:
    rows = [row[0] for row in table("episodes.md", heading)]
    assert [value.value for value in values] == rows[: len(values)]


def test_every_controller_is_documented() -> None:
    section = read("protocol.md").split("\n| `controller` |")[1].split("\n\n")[0]
    named = set(re.findall(r"`([a-z-]+)`", section)) | {""}
    assert named == {controller.value for controller in Controller}
    assert "| empty |" in section


def test_every_role_is_documented() -> None:
    section = read("protocol.md").split("\n## Roles and tokens\n")[1].split("\n## ")[0]
    assert set(re.findall(r"`([a-z]+)`", section)) >= {role.value for role in Role}


def test_blocks_of_recordings_have_the_documented_size() -> None:
    for page in ("recordings.md", "decisions/0021-torn-and-damaged-recordings.md"):
        sizes = re.findall(r"(\d+) KiB", read(page))
        assert sizes == [str(BLOCK // 1024)], page


def test_numbers_of_the_protocol_are_those_of_the_code() -> None:
    page = " ".join(read("protocol.md").split())
    defaults, kib = ServerSettings(), 1024
    rate = defaults.messages_per_second
    assert (
        f"| {codec.MAX_CLIENT_BYTES // kib} KiB "
        f"({message_budget.MAX_HELLO_BYTES // kib} KiB before `welcome`) |" in page
    )
    assert f"| {codec.MAX_ITEMS} values, {codec.MAX_FIELDS} fields per object |" in page
    assert f"| {rate:g} per second, bursts of {2 * rate:g} |" in page
    assert f"closed after {message_budget.MAX_REFUSED} refusals" in page
    assert f"| {FRAMES_A_SECOND:g} per second, bursts of {FRAMES_BURST:g} |" in page
    assert f"closed after {MAX_EXCESS} more" in page
    assert f"| {SEAT_QUOTA_BYTES // kib**2} MiB per episode;" in page
    assert f"| {WRONG_CODES_A_MINUTE} per minute |" in page
    (sentence,) = re.findall(r"Some messages count as several: ([^.]*)\.", page)
    costs = {
        name: float(part.split()[-1])
        for part in sentence.split(", ")
        for name in re.findall("`(.*?)`", part)
    }
    types = {m.model_fields["type"].default: cost for m, cost in message_budget.COSTS.items()}
    assert costs == types
    assert f"While more than {peer.MAX_UNSENT // kib} KiB wait" in page
    assert f"more than {peer.MAX_HELD // kib**2} MiB waiting" in page
    assert f"After {defaults.stall_seconds:g} seconds (setting `stall_seconds`)" in page
    assert f"more than {broadcaster.KEPT_DELTAS} steps" in page
    assert f"of the last {broadcaster.KEPT_SAID};" in page
    assert f"a complete state and the last {broadcaster.REPEATED_SAID} `said`" in page
    first, longest = backoff.FIRST_DELAY * 1000, backoff.MAX_DELAY
    assert f"between {first:g} and {2 * first:g} ms" in page
    assert f"then up to {longest / 2:g} and {longest:g} s" in page
    early, attempts = backoff.MAX_EARLY_DELAY, backoff.EARLY_ATTEMPTS
    assert f"up to {early / 2:g} and {early:g} s in the first {attempts} attempts" in page
    words = {120: "two minutes", 10: "ten letters"}
    assert words[int(lobby.LINGER_SECONDS)] in page
    assert words[room_factory.CODE_LENGTH] in page


def test_budgets_are_those_of_the_code() -> None:
    one, two, three, four = (f"{BUDGET.for_seats(n).expansions:,}" for n in range(1, 5))
    page = read("planners.md")
    assert f"`--expansions` (default {one}) and `--states` (default {BUDGET.states:,}," in page
    assert f"{two} for two, {three} for three and {four} for four" in page
    assert f"with {BUDGET.states:,} states kept" in page


def test_every_decision_is_listed() -> None:
    listed = [link for link in links(DOCS / "decisions" / "README.md") if link.startswith("0")]
    found = sorted(path.name for path in (DOCS / "decisions").glob("0*.md"))
    assert listed == found


def test_every_page_is_listed() -> None:
    listed = {link.partition("#")[0] for link in links(DOCS / "README.md")}
    assert {path.name for path in DOCS.glob("*.md")} - {"README.md"} <= listed


def entry_points() -> dict[str, str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return dict(project["project"]["scripts"])


def test_every_command_is_documented() -> None:
    sections = re.findall(r"^## (\S+)$", read("cli.md"), re.MULTILINE)
    assert sections == list(entry_points())
    for target in entry_points().values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_flags_of_the_server_are_those_of_the_table() -> None:
    app = typer.Typer(add_completion=False)
    module = importlib.import_module("robotouille_server.cli")
    app.command()(module._flags(ServerSettings, module.run))
    options = typer.main.get_command(app).params
    flags = {flag for o in options for flag in (*o.opts, *o.secondary_opts)} - {
        "--help",
        "--version",
    }
    documented = [row[0] for row in table("settings.md", "Settings")]
    names = [name.partition("`")[0] for name in documented]
    assert names == list(ServerSettings.model_fields)
    with_flag = {name for name, row in zip(names, documented, strict=True) if "no flag" not in row}
    assert {f"--{name.replace('_', '-')}" for name in with_flag} == {
        flag for flag in flags if not flag.startswith("--no-")
    }


def test_secrets_are_no_flags() -> None:
    fields = ServerSettings.model_fields
    secrets = {name for name in fields if SecretStr in SECRET and fields[name].annotation in SECRET}
    assert secrets == {"signing_keys", "mqtt_password"}
    for row in table("settings.md", "Settings"):
        assert ("no flag" in row[0]) == (row[0].partition("`")[0] in secrets)


def test_every_metric_is_documented() -> None:
    documented = {row[0] for row in table("settings.md", "Metrics")}
    exposed = {
        family.name + ("_total" if family.type == "counter" else "")
        for family in node_metrics().registry.collect()
    }
    assert documented == exposed


def test_every_reason_to_drop_a_connection_is_documented() -> None:
    texts = [p.read_text(encoding="utf-8") for p in SOURCES if "robotouille_server" in p.parts]
    pattern = r"(?:(?:dropped|count)\.labels|\.drop)\(\"([a-z]+)\"\)"
    reasons = {reason for text in texts for reason in re.findall(pattern, text)}
    section = read("operate_a_server.md").split("| reason | cause |")[1].split("\n\n")[0]
    assert set(re.findall(r"^\| `([a-z]+)` \|", section, re.MULTILINE)) == reasons


def test_every_signal_is_documented() -> None:
    rows = [row[0] for row in table("operate_a_server.md", "Restart and upgrade")]
    text = (ROOT / "server/robotouille_server/cli.py").read_text(encoding="utf-8")
    assert set(re.findall(r"SIG(?:INT|TERM)", text)) <= set(re.findall(r"SIG[A-Z]+", str(rows)))


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
