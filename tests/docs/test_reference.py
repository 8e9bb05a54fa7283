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

from robotouille.certification.certifying import BUDGET
from robotouille.episode import Absence, Controller, PauseReason
from robotouille.episode.quota import SEAT_QUOTA_BYTES
from robotouille.errors import ProtocolError
from robotouille.protocol import codec, messages
from robotouille_client.sansio import backoff
from robotouille_server import ServerSettings
from robotouille_server.auth.roles import Role
from robotouille_server.auth.visitors import WRONG_CODES_A_MINUTE
from robotouille_server.cli import SECRET
from robotouille_server.conversation import message_budget
from robotouille_server.limit_table import LIMITS, shown_value
from robotouille_server.rooms import lobby
from robotouille_server.rooms.broadcast import broadcaster
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport import peer
from robotouille_server.transport.connection import FRAMES_A_SECOND, FRAMES_BURST, MAX_EXCESS
from tests.support.pages import DOCS, PAGES, anchors, links, prose, read, table, titled
from tests.support.sources import ROOT

MEANINGS = json.loads(read("messages.json"))
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


FAMILIES = "action|auth|episode|message|protocol|rate|seat|server|session|state|task"
NO_CODES = {"robotouille/role", "robotouille/resume"}
OPERATORS = ROOT / "server/robotouille_server/admin"
"""Its HTTP API has codes of its own, in docs/operator.md."""


def strings(text: str) -> Iterable[str]:
    """All string literals of a source."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def codes_in_the_sources() -> set[str]:
    """What looks like a code, and whatever is given to those who send one."""
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


def test_every_error_code_is_documented() -> None:
    documented = [row[0] for row in table("protocol.md", "Errors")]
    assert sorted(documented) == sorted(codes_in_the_sources())


def test_every_farewell_is_documented() -> None:
    """The codes of `bye`, and whether one may come back."""
    texts = [p.read_text(encoding="utf-8") for p in SOURCES if "robotouille_server" in p.parts]
    given = {code for text in texts for code in re.findall(r"\.close\(\s*\"([a-z/-]+)\"", text)}
    rows = {row[0]: row[2] for row in table("protocol.md", "When the server closes")}
    assert rows.keys() == given
    again = {"server/restart", "auth/silent", "rate/connections"}
    assert {code for code, retry in rows.items() if retry} == again


@pytest.mark.parametrize(
    ("heading", "values"),
    [("Absence", Absence), ("Pauses", PauseReason)],
)
def test_every_rule_and_reason_is_documented(heading: str, values: type[StrEnum]) -> None:
    rows = [row[0] for row in table("protocol.md", heading)]
    assert [value.value for value in values] == rows[: len(values)]


def test_every_controller_is_documented() -> None:
    section = read("protocol.md").split("\n| `controller` |")[1].split("\n\n")[0]
    named = set(re.findall(r"`([a-z-]+)`", section)) | {""}
    assert named == {controller.value for controller in Controller}
    assert "| empty |" in section


def test_every_role_is_documented() -> None:
    section = read("protocol.md").split("\n## Roles and tokens\n")[1].split("\n## ")[0]
    assert set(re.findall(r"`([a-z]+)`", section)) >= {role.value for role in Role}


def test_an_error_carries_its_code() -> None:
    with pytest.raises(ProtocolError) as caught:
        codec.JSON.decode_client('{"type": "zap"}')
    assert caught.value.code == "message/unknown-type"


def test_every_limit_is_on_its_page() -> None:
    rows = [row for title in LIMITS for row in table("limits.md", title)]
    assert [(row[0], row[1]) for row in rows] == [
        (limit.what.strip(" `"), shown_value(limit))
        for limits in LIMITS.values()
        for limit in limits
    ]


def test_numbers_of_the_protocol_are_those_of_the_code() -> None:
    page = " ".join(read("protocol.md").split())
    defaults, kib = ServerSettings(), 1024
    rate = defaults.messages_per_second
    listing, look, picture = (
        message_budget.COSTS[m]
        for m in (messages.ListEpisodes, messages.GetRendering, messages.GetPicture)
    )
    assert listing == look
    assert f"at most {codec.MAX_CLIENT_BYTES // kib} KiB" in page
    assert f"{rate:g} messages a second, in bursts of {2 * rate:g}" in page
    joining, resync = (message_budget.COSTS[m] for m in (messages.Join, messages.Resync))
    assert joining == resync
    counts = f"`join` and `resync` count as {joining}, `list` and `get_rendering` as {listing}"
    assert f"{counts}, `get_picture` as {picture}" in page
    assert f"({message_budget.MAX_HELLO_BYTES // kib} KiB before `hello` is answered)" in page
    assert f"{codec.MAX_ITEMS} values in all and {codec.MAX_FIELDS} fields in one object" in page
    assert f"parts of messages: {FRAMES_A_SECOND:g} a second, in bursts of {FRAMES_BURST:g}" in page
    assert f"after {MAX_EXCESS} more it is cut off" in page
    assert f"chat) are {SEAT_QUOTA_BYTES // kib**2} MiB in an episode" in page
    assert f"after {message_budget.MAX_REFUSED} of them the connection is closed" in page
    assert f"From {peer.MAX_UNSENT // kib} KiB of unread bytes" in page
    assert f"from {peer.MAX_UNSENT // kib} KiB of unsent bytes" in page
    assert f"more than {peer.MAX_HELD // kib**2} MiB unsent" in page
    assert f"After {defaults.stall_seconds:g} seconds behind" in page
    assert f"more than {broadcaster.KEPT_DELTAS}, or" in page
    assert f"of the last {broadcaster.KEPT_SAID};" in page
    first, longest = backoff.FIRST_DELAY * 1000, backoff.MAX_DELAY
    assert f"After {first:g} ms, then after pauses that double up to {longest:g} s" in page
    words = {120: "two minutes", 10: "ten letters", 20: "Twenty wrong codes a minute"}
    assert words[int(lobby.LINGER_SECONDS)] in page
    assert words[lobby.CODE_LENGTH] in page
    assert words[WRONG_CODES_A_MINUTE] in page


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


def entry_points() -> dict[str, str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return dict(project["project"]["scripts"])


def test_every_command_is_documented() -> None:
    for name, target in entry_points().items():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))
        assert f"`{name}" in read("settings.md")
        if name != "robotouille-server":
            assert f"\n### `{name}" in read("settings.md")


def test_flags_of_the_server_are_those_of_the_table() -> None:
    app = typer.Typer(add_completion=False)
    module = importlib.import_module("robotouille_server.cli")
    app.command()(module._flags(ServerSettings, module.run))
    options = typer.main.get_command(app).params
    flags = {flag for o in options for flag in (*o.opts, *o.secondary_opts)} - {
        "--help",
        "--version",
    }
    documented = [row for row in table("settings.md", "The server") if len(row) == 5]
    assert {flag for row in documented for flag in re.findall(r"--[a-z-]+", row[0])} == flags
    assert [row[1].split("`")[-1] for row in documented] == list(ServerSettings.model_fields)


def test_secrets_are_no_flags() -> None:
    fields = ServerSettings.model_fields
    secrets = {name for name in fields if SecretStr in SECRET and fields[name].annotation in SECRET}
    assert secrets == {"signing_keys", "mqtt_password"}
    for row in table("settings.md", "The server"):
        assert (row[0] == "none") == (row[1].split("`")[-1] in secrets)


def test_every_setting_that_is_explained_exists() -> None:
    """What the page says below its tables is about settings that there are."""
    text = prose(DOCS / "settings.md").split("<!-- end generated: settings -->")[1]
    text = text.split("## Metrics")[0]
    named = set(re.findall(r"^\* ((?:`[a-z_]+`(?:, | and )?)+)", text, re.MULTILINE))
    settings = {name for words in named for name in re.findall(r"`([a-z_]+)`", words)}
    assert len(settings) > 15
    assert settings <= set(ServerSettings.model_fields)


def test_every_metric_is_documented() -> None:
    documented = {row[0] for row in table("settings.md", "Metrics")}
    exposed = {
        family.name + ("_total" if family.type == "counter" else "")
        for family in Metrics().registry.collect()
    }
    assert documented == exposed


def test_every_reason_to_drop_a_connection_is_documented() -> None:
    texts = [p.read_text(encoding="utf-8") for p in SOURCES if "robotouille_server" in p.parts]
    pattern = r"(?:(?:dropped|count)\.labels|\.drop)\(\"([a-z]+)\"\)"
    reasons = {reason for text in texts for reason in re.findall(pattern, text)}
    rows = {row[0]: row[1] for row in table("settings.md", "Metrics")}
    words = rows["robotouille_dropped_connections_total"]
    assert set(re.findall(r"`([a-z]+)` \(", words)) == reasons


def test_every_signal_is_documented() -> None:
    rows = [row[0] for row in table("settings.md", "Signals")]
    text = (ROOT / "server/robotouille_server/cli.py").read_text(encoding="utf-8")
    assert set(re.findall(r"SIG(?:INT|TERM)", text)) <= set(re.findall(r"SIG[A-Z]+", str(rows)))


def test_every_module_of_the_server_is_on_the_map() -> None:
    rows = [row[0] for row in table("architecture.md", "The server")]
    named = {name.strip("`") for row in rows for name in row.split(", ")}
    folder = ROOT / "server/robotouille_server"
    modules = {p.relative_to(folder).with_suffix("").as_posix() for p in folder.rglob("*.py")}
    assert named == {name for name in modules if "__" not in name}


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
