"""Pages of recordings: their content, their size, and what they must not contain."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotouille import State, UnknownNameError
from robotouille.certification.certificate import Deadline
from robotouille.domain.rendering import rendering_of
from robotouille.protocol.states import StateReader
from robotouille.replay.compression import compress, unwrap
from robotouille.replay.container import MAGIC, pack_frame, read_frames
from robotouille.replay.controllers import seatings
from robotouille.replay.recording import Recording
from robotouille.web import recording_page
from robotouille.web.recording_page import (
    labels,
    page_data,
    replay_page,
    steps_to_go,
)
from robotouille.web.single_file import JsonRows, encoded
from robotouille.web.site import STATIC, WebSite
from robotouille_client.cli.main import app
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from robotouille_server import Server
from tests.support.games import recorded_game
from tests.support.page_tags import Tags
from tests.support.random_play import random_stream, talkative_stream
from tests.support.replay_pages import page_data_of, unpacked
from tests.support.samples import quick_sample
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

KITCHEN = 300 * 1024
"""Bytes of a page before its steps: modules, pictures and the task."""
STEP = 20
"""Bytes of a step."""
EVIL = '</script><img src=x onerror="document.title=1">'
"""Text that would be a picture and run a script if it were markup."""


@pytest.fixture(scope="module")
def game() -> Recording:
    return Recording(recorded_game("multi_agent/09@2", steps=300))


def data_of(*streams: bytes, **options: Any) -> dict[str, Any]:
    return page_data([(f"game{n}", Recording(each)) for n, each in enumerate(streams)], **options)


def command(*words: str | Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["replay", "page", *map(str, words)])
    return done.exit_code, done.output


# Files


def test_server_does_not_serve_the_page() -> None:
    site = WebSite()
    assert site.find("replay/main.js") is None
    assert b"replay/" not in site.page().content


# Content


def test_data_are_the_states_of_the_recording(game: Recording) -> None:
    (row,) = data_of(game.stream)["recordings"]
    assert row["steps"] == game.length == len(row["deltas"])
    snapshot = row["snapshot"]
    reader = StateReader(game.world, snapshot, snapshot)
    states = dict(game.states())
    assert reader.state == states[0]
    for step, delta in enumerate(row["deltas"], 1):
        assert reader.apply(delta) == states[step]


@pytest.mark.slow
def test_lanes_times_and_seats_are_those_of_the_viewer() -> None:
    for seed in range(6):
        recording = Recording(random_stream(seed))
        history = RecordedHistory(recording)
        (row,) = data_of(recording.stream)["recordings"]
        times = [0]
        for passed in row["times"]:
            times.append(times[-1] + passed)
        assert times == list(history.times)
        for player, lane in zip(recording.world.players, row["lanes"], strict=True):
            assert lane == "".join("sxabwi"[code] for code in history.lanes[player])
        starts = dict(row["seats"])
        shown: list[Any] = []
        for step, seats in seatings(recording):
            shown = starts.get(step, shown)
            expected = [[s.name, s.kind, s.controller] for s in seats.values()]
            assert shown == expected


def test_moves_are_the_actions_that_were_applied(game: Recording) -> None:
    (row,) = data_of(game.stream)["recordings"]
    for frame, moves in zip(game.steps, row["moves"], strict=True):
        lost = frame.get("unmet", {})
        applied = [m for i, m in enumerate(frame["moves"]) if str(i) not in lost]
        seats = [game.world.players.index(move["player"]) for move in applied]
        assert moves[::2] == seats
        assert [row["actions"][n] for n in moves[1::2]] == [move["action"] for move in applied]


def test_log_has_chat_rejections_and_thoughts() -> None:
    stream = talkative_stream(("ada", "p-ada"), "sam", "s-ada", "words")
    (row,) = data_of(stream)["recordings"]
    kinds = [kind for _, _, kind, *_ in row["log"]]
    assert kinds.count("said") == 2
    assert kinds.count("rejected") == 2
    assert {"joined", "left", "noted", "announced", "thought"} <= set(kinds)
    said = [rest for _, _, kind, *rest in row["log"] if kind == "said"]
    assert said == [[0, "ada", "say words"], [-1, "sam", "watch words"]]


def test_steps_to_go_become_exact_at_the_goal() -> None:
    recording = Recording(recorded_game("synchronous/01", steps=20))
    *_, rows = steps_to_go(recording, recording.length, Deadline())
    assert len(rows) == recording.length + 1
    for least, most in filter(None, rows):
        assert least == -1 or most is None or 0 <= least <= most


def test_labels_leave_out_what_all_files_share() -> None:
    assert labels(["1_soup_a", "2_soup_b"]) == ["1 a", "2 b"]
    assert labels(["same", "same"]) == ["same", "same"]
    assert labels(["one_alone"]) == ["one alone"]


# Size, safety and privacy


def test_page_is_small(game: Recording) -> None:
    page = replay_page([("game", game)])
    assert len(page.encode()) <= KITCHEN + STEP * game.length


@pytest.mark.parametrize(
    ("task", "share"),
    quick_sample([("shifts/05@2", 1.0), ("multi_agent/09@2", 0.9), ("workshop/02", 1.0)]),
)
def test_page_has_the_pictures_that_appear_and_few_others(task: str, share: float) -> None:
    recording = Recording(recorded_game(task, steps=150))
    pictures = page_data([("game", recording)])["look"]["pictures"]
    resolver = AppearanceResolver(recording.task.domain, rendering_of(recording.task))
    for _, state in recording.states():
        stage = resolver.stage(state)
        shown = [*stage.stations.values(), *(p.appearance for p in chain(*stage.piles.values()))]
        assert {look.asset for look in shown if look.asset} <= pictures.keys()
    assert len(pictures) <= share * len(rendering_of(recording.task).files())


def test_equal_recordings_give_equal_pages(game: Recording) -> None:
    assert replay_page([("game", game)]) == replay_page([("game", Recording(game.stream))])


def test_texts_never_become_markup() -> None:
    stream = talkative_stream((EVIL, "p"), EVIL, "s", EVIL)
    page = replay_page([(EVIL, Recording(stream))])
    assert EVIL not in page
    assert "onerror" not in page
    tags = [tag for tag, _ in Tags(page).found]
    assert tags.count("script") == 3
    assert "img" not in tags
    # The data have the texts as they are, and the page shows them as text.
    assert EVIL in json.dumps(page_data_of(page)["recordings"][0]["log"]).replace('\\"', '"')


def test_policy_allows_only_the_scripts_and_styles_of_the_page(game: Recording) -> None:
    page = replay_page([("game", game)])
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == rules["connect-src"] == "'none'"
    boot = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)[0]
    style = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)[0]
    assert rules["script-src"] == f"{digest(boot)} data:"
    assert rules["style-src"] == digest(style)
    assert "unsafe" not in policy
    assert "http:" not in page
    assert "https:" not in page


def digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def test_anonymous_page_has_no_names_and_no_texts() -> None:
    secrets = ("Ada-Secret", "pseudonym-secret", "Sam-Secret", "session-secret", "words-secret")
    person, pseudonym, spectator, session, words = secrets
    stream = talkative_stream((person, pseudonym), spectator, session, words)
    shown = replay_page([("label-secret", Recording(stream))], anonymous=True)
    whole = json.dumps(page_data_of(shown))
    for secret in (*secrets, "label-secret", "CODE-0", "some-owner", "talkative"):
        assert secret not in whole
        assert secret not in shown
    (row,) = page_data_of(shown)["recordings"]
    names = {cook[0] for _, cooks in row["seats"] for cook in cooks if cook[0]}
    assert names == {"p1", "p2"}
    kinds = [kind for _, _, kind, *_ in row["log"]]
    assert kinds.count("said") == 2
    assert "thought" not in kinds
    assert "noted" not in kinds


SHOWN = {
    "act", "argument", "broken", "chat", "cheer", "late", "name", "note", "noun", "spectator",
    "thought", "topic", "why",
}  # fmt: skip
"""Words of `told_everything` that a page shows if it is not anonymous."""


@asynccontextmanager
async def guest(
    server: Server, name: str, join: dict[str, Any], **hello: str
) -> AsyncIterator[Raw]:
    """Open a connection that joins an episode."""
    async with raw(server, hello=False) as connection:
        greeting = {"type": "hello", "protocol": 1, "name": name, **hello}
        assert (await connection.ask(greeting, "welcome"))["type"] == "welcome"
        joined = await connection.ask({"type": "join", **join}, "joined")
        assert joined["type"] == "joined", joined
        yield connection


async def told_everything(folder: Path) -> set[str]:
    """Play a game whose people write `WORD-secret` into every field; return its code and tokens."""
    order = {
        "type": "create",
        "task": "multi_agent/01",
        "clock": "lockstep",
        "chat": "free",
        "tokens": True,
        "labels": {"key-secret": "label-secret"},
        "participants": {"robot1": "pseudonym-secret"},
    }
    said = [
        {"type": "say", "text": "chat-secret"},
        {"type": "note", "topic": "topic-secret", "text": "note-secret"},
        {"type": "signal", "intent": "look", "target": "target-secret"},
        {"type": "act", "seq": 1, "action": "act-secret", "reasoning": "hope-secret"},
        {"type": "act", "seq": 2, "action": {"name": "noun-secret", "args": ["argument-secret"]}},
        {"type": "act", "seq": 3, "action": {"name": "broken-secret", "args": 5}},
        {"type": "act", "seq": 4, "action": "late-secret", "basis": 9, "max_age": 0},
        {"type": "act", "seq": 5, "action": 0, "basis": 0, "reasoning": "thought-secret"},
    ]
    async with serving(folder) as server, raw(server) as host:
        created = await host.ask(order, "created")
        tokens = created["tokens"]
        first = {"episode": created["code"], "agent": "agent-secret", "view": "both"}
        watch = {"episode": created["code"], "role": "spectator"}
        async with (
            guest(server, "name-secret", first, token=tokens["robot1"]) as ada,
            guest(server, "other", {"episode": created["code"]}, token=tokens["robot2"]) as ben,
            guest(server, "spectator-secret", watch) as sam,
        ):
            await sam.ask({"type": "say", "text": "cheer-secret"}, "said")
            for message in said:
                await ada.send(message)
            await ben.send({"type": "act", "seq": 1, "action": None})
            await ben.expect("delta")
            order = {"type": "close", "episode": created["episode"], "reason": "why-secret"}
            await host.send(order)
            await ada.expect("ended")
        await server.lobby.closed()
    return {created["code"], *tokens.values()}


@pytest.mark.slow
@virtual
async def test_anonymous_page_of_a_served_game_has_nothing_that_its_people_wrote(
    tmp_path: Path,
) -> None:
    tokens = await told_everything(tmp_path)
    recording = Recording(unwrap(next(tmp_path.glob("*.rbt")).read_bytes()))
    usual, anonymous = (
        replay_page([("label", recording)], anonymous=hidden) for hidden in (False, True)
    )
    assert set(re.findall(r"(\w+)-secret", unpacked(usual, "data"))) == SHOWN
    for text in (anonymous, unpacked(anonymous, "data")):
        assert "secret" not in text
        assert not any(token in text for token in tokens)


def test_anonymous_names_are_the_same_in_both_recordings() -> None:
    people = (("ada", "p0"), ("ben", "p1"))
    streams = [random_stream(1, people=people), random_stream(1, people=people[::-1])]
    rows = data_of(*streams, anonymous=True)["recordings"]
    first, second = (row["seats"][0][1] for row in rows)
    assert [cook[0] for cook in first] == [cook[0] for cook in second][::-1] == ["p1", "p2"]


# The command


@pytest.mark.slow
def test_command_writes_a_page(tmp_path: Path) -> None:
    file, page = tmp_path / "game.rbt", tmp_path / "page.html"
    file.write_bytes(compress(random_stream(3)))
    status, output = command(file, page, "--seconds", "5")
    assert status == 0, output
    (row,) = page_data_of(page.read_text(encoding="utf-8"))["recordings"]
    assert len(row["to_go"]) == row["steps"] + 1


def test_command_shows_two_recordings_of_one_task(tmp_path: Path) -> None:
    one, other, page = (tmp_path / name for name in ("a.rbt", "b.rbt", "page.html"))
    one.write_bytes(recorded_game("synchronous/01", seed=1, steps=20))
    other.write_bytes(recorded_game("synchronous/01", seed=2, steps=20))
    status, output = command(one, other, page, "--no-steps-to-go")
    assert status == 0, output
    rows = page_data_of(page.read_text(encoding="utf-8"))["recordings"]
    assert [row["label"] for row in rows] == ["a", "b"]
    assert "to_go" not in rows[0]
    other.write_bytes(recorded_game("synchronous/02", steps=20))
    status, output = command(one, other, page, "--no-steps-to-go")
    assert status == 1
    assert "same task" in output


def test_damaged_recordings_are_shown_up_to_the_damage(tmp_path: Path) -> None:
    stream = random_stream(3)
    file, page = tmp_path / "game.rbt", tmp_path / "page.html"
    torn = bytearray(stream)
    torn[len(torn) * 2 // 3] ^= 0xFF
    file.write_bytes(torn)
    status, output = command(file, page, "--no-steps-to-go")
    assert status == 0, output
    assert "steps before the damage" in output
    (row,) = page_data_of(page.read_text(encoding="utf-8"))["recordings"]
    assert 0 < row["steps"] < Recording(stream).length
    assert row["fault"]
    assert row["outcome"] is None


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"RBTL\x09", "format version 9"), (b"\x89PNG", "not a recording"), (b"", "not a recording")],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    file, page = tmp_path / "game.rbt", tmp_path / "page.html"
    file.write_bytes(content)
    status, output = command(file, page)
    assert status == 1
    assert message in output.replace("\n", " ")
    assert not page.exists()


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    file = tmp_path / "game.rbt"
    with file.open("wb") as sparse:
        sparse.truncate(1 << 30)
    status, output = command(file, tmp_path / "page.html")
    assert status == 1
    assert "larger than" in output.replace("\n", " ")


def test_the_page_never_replaces_a_recording(tmp_path: Path) -> None:
    files = [tmp_path / "a.rbt", tmp_path / "b.rbt"]
    for file in files:
        file.write_bytes(random_stream(3))
    before = files[1].read_bytes()
    status, output = command(*files)
    assert status == 1
    assert "must end with .html" in output.replace("\n", " ")
    assert files[1].read_bytes() == before


def test_page_uses_only_files_of_the_package() -> None:
    for name in ("index.html", "boot.js", "replay.css"):
        assert (STATIC / "replay" / name).is_file()


def test_texts_without_an_action_are_read_up_to_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes a millisecond, and a recording can have 300,000."""
    stream = recorded_game("synchronous/01", steps=5)
    recording, (head, start, *others) = Recording(stream), read_frames(stream)
    note = {"note": "rejected", "t": 0, "player": "robot1", "seq": 1, "action": "fly",
            "reasons": ["no"]}  # fmt: skip
    frames = (head, start, {"kind": "notes", "notes": [note] * 9}, *others)
    forged = Recording(MAGIC + b"".join(map(pack_frame, frames)))
    forged.world, parsed = recording.world, []

    def parse(state: State, player: str, text: str, **_: object) -> None:
        parsed.append(text)
        raise UnknownNameError(text)

    monkeypatch.setattr(forged.world, "parse", parse)
    monkeypatch.setattr(recording_page, "MAX_UNREAD", 4)
    (row,) = page_data([("game", forged)])["recordings"]
    assert len(parsed) == 4
    assert [told[4] for told in row["log"] if told[2] == "rejected"] == ["fly"] * 9


def test_page_of_too_much_data_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, page = tmp_path / "a.rbt", tmp_path / "a.html"
    file.write_bytes(compress(recorded_game("synchronous/01", steps=50)))
    monkeypatch.setattr(recording_page, "MAX_DATA", 2 * 1024**2)
    assert command(file, page, "--no-steps-to-go")[0] == 0
    monkeypatch.setattr(recording_page, "MAX_DATA", 2 * 1024)
    page.unlink()
    status, output = command(file, page, "--no-steps-to-go")
    assert status == 1
    assert "a page shows at most" in output
    assert not page.exists()


def test_texts_of_data_cannot_take_the_place_of_rows() -> None:
    rows = JsonRows([["0", {"a": "\ud800"}], [], 1])
    data = {"label": '"0', "rows": rows, "more": [JsonRows(), "1"]}
    expected = {"label": '"0', "rows": [["0", {"a": "?"}], [], 1], "more": [[], "1"]}
    assert json.loads(encoded(data)) == expected
    rows.cut(1)
    assert (len(rows), rows[0], rows[:]) == (1, ["0", {"a": "\ud800"}], [["0", {"a": "\ud800"}]])
