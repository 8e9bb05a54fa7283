"""The list of recordings: what each is told by, whatever the file holds."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from tests.support.forms import drawn
from tests.support.golden_screens import proven_game
from tests.support.viewer_pictures import eventful
from tests.support.window_play import follow, post

from robotouille.replay.container import frame_ends, frame_value, plain
from robotouille_client.window.forms.display import Display
from robotouille_client.window.shell.screens import recording_summary
from robotouille_client.window.shell.screens.recording_summary import (
    MAX_FIRST,
    summary_of,
    when_words,
)
from robotouille_client.window.shell.screens.replays_menu import ReplaysMenu, recent_recordings

NOW = datetime(2026, 11, 22, 14, 5, tzinfo=UTC)


@pytest.mark.parametrize(
    ("ago", "words"),
    [
        (timedelta(0), "today 14:05"),
        (timedelta(hours=14), "today 0:05"),
        (timedelta(hours=15), "yesterday 23:05"),
        (timedelta(days=3), "19 Nov 14:05"),
        (timedelta(days=400), "18 Oct 2025"),
    ],
)
def test_when_a_game_was(ago: timedelta, words: str) -> None:
    assert when_words(NOW - ago, NOW) == words


def test_recordings_are_told_by_their_task_and_result(
    display: Display, tmp_path: Path, recording: bytes
) -> None:
    whole = tmp_path / "20261122T120000Z_a.rbt"
    whole.write_bytes(recording)
    damaged = {
        "cut.rbt": recording[: len(recording) // 2], "none.rbt": b"", "text.rbt": b"Hello",
        "version.rbt": b"RBTL\x63" + bytes(40), "noise.rbt": recording[:60] + os.urandom(300),
    }  # fmt: skip
    for name, content in damaged.items():
        (tmp_path / name).write_bytes(content)
    paths = [whole, *(tmp_path / name for name in damaged), tmp_path / "gone.rbt"]
    menu = ReplaysMenu(paths)
    while menu.form.idle():
        drawn(menu.form, (800, 600))
    told = {entry.answer: entry.told() for entry in menu.form.entries}
    title, detail = told[whole]
    assert title == "Synchronous 01: cheese sandwich"
    assert "won in 8 steps" in detail
    assert (
        "Played by robot1-bot." in next(e for e in menu.form.entries if e.answer == whole).about()
    )
    assert "damaged" in told[tmp_path / "cut.rbt"].detail
    assert "not a recording" in told[tmp_path / "text.rbt"].detail
    assert "format version 99" in told[tmp_path / "version.rbt"].detail
    for name in ("none.rbt", "noise.rbt"):
        assert told[tmp_path / name].detail
    assert "No such file" in told[tmp_path / "gone.rbt"].detail
    post("cheese won")
    follow(menu.form)
    assert menu.form.focused is not None
    assert menu.form.focused.answer == whole


def test_games_that_were_cut_off_are_listed_and_those_under_way_are_not(
    display: Display, tmp_path: Path, recording: bytes
) -> None:
    ages = {"whole.rbt": 5.0, "cut.rbt.part": 600.0, "now.rbt.part": 2.0, "both.rbt.part": 900.0,
            "both.rbt": 700.0, "draft.rbt.tmp": 800.0}  # fmt: skip
    for name, ago in ages.items():
        (tmp_path / name).write_bytes(recording)
        os.utime(tmp_path / name, (time.time() - ago,) * 2)
    stream, _ = plain(recording, 1 << 20)
    (tmp_path / "cut.rbt.part").write_bytes(stream[: [*frame_ends(stream)][-3]])
    os.utime(tmp_path / "cut.rbt.part", (time.time() - 600.0,) * 2)
    paths = recent_recordings([tmp_path, tmp_path / "none"])
    assert [path.name for path in paths] == ["whole.rbt", "cut.rbt.part", "both.rbt"]
    menu = ReplaysMenu(paths)
    assert menu.form.entries[1].told().title == "cut"
    while menu.form.idle():
        drawn(menu.form, (800, 600))
    assert "not played to its end" in menu.form.entries[1].told().detail


def test_what_is_no_file_is_no_recording(tmp_path: Path) -> None:
    """A pipe has no other end, a device has no end at all."""
    os.mkfifo(tmp_path / "pipe.rbt")
    (tmp_path / "folder.rbt").mkdir()
    (tmp_path / "zero.rbt").symlink_to("/dev/zero")
    (tmp_path / "circle.rbt").symlink_to(tmp_path / "circle.rbt")
    (tmp_path / "gone.rbt").symlink_to(tmp_path / "nothing")
    assert recent_recordings([tmp_path]) == []
    for name in ("pipe", "zero"):
        assert summary_of(tmp_path / f"{name}.rbt").fault == "no file"


def test_times_beyond_all_calendars(
    tmp_path: Path, recording: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.rbt"
    path.write_bytes(recording)
    told = path.stat()
    monkeypatch.setattr(Path, "stat", lambda *_, **__: os.stat_result((*told[:8], 10**15, 10**15)))
    assert summary_of(path).result
    west, east = timezone(timedelta(hours=-12)), timezone(timedelta(hours=12))
    assert when_words(datetime.min.replace(tzinfo=UTC), NOW.astimezone(west))
    assert when_words(datetime.max.replace(tzinfo=UTC), NOW.astimezone(east))


def test_of_a_long_recording_a_few_frames_are_read_and_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that a list of fifty is there at once."""
    read: list[int] = []

    def counted(stream: bytes, start: int, end: int) -> dict[str, Any]:
        read.append(start)
        return frame_value(stream, start, end)

    monkeypatch.setattr(recording_summary, "frame_value", counted)
    path = tmp_path / "long.rbt"
    path.write_bytes(eventful(60))
    assert summary_of(path).steps == 60
    assert len(read) <= 1 + MAX_FIRST
    read.clear()
    assert summary_of(path).steps == 60
    assert not read


@pytest.fixture(scope="module")
def recording() -> bytes:
    return proven_game()
