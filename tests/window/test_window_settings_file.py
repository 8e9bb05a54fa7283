"""Several windows of one person: each writes what it has changed, and takes nothing back."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille_client.window.shell import settings as settings_module
from robotouille_client.window.shell.settings import (
    Settings,
    SettingsFile,
    load_settings,
    save_settings,
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "window.json"


def opened(path: Path) -> tuple[Settings, SettingsFile]:
    settings, _ = load_settings(path)
    return settings, SettingsFile(path, settings)


def kept(path: Path) -> Settings:
    settings, told = load_settings(path)
    assert told == ""
    return settings


def test_a_window_writes_only_what_it_has_changed(path: Path) -> None:
    save_settings(Settings(name="ada", code="OLD"), path)
    (one, first), (other, second) = opened(path), opened(path)
    one.code = "NEW"
    one.prefer(server="ws://there")
    assert first.save(one) == ""
    other.learned = True
    assert second.save(other) == ""
    assert second.save(other) == ""
    assert kept(path) == Settings(name="ada", code="NEW", server="ws://there", learned=True)


def test_of_two_best_games_the_better_one_is_kept(path: Path) -> None:
    save_settings(Settings(best={"a@1": 50, "b@1": 9}), path)
    (one, first), (other, second) = opened(path), opened(path)
    one.best |= {"a@1": 30, "c@2": 70}
    other.best |= {"a@1": 40, "b@1": 8}
    assert first.save(one) == second.save(other) == ""
    assert kept(path).best == {"a@1": 30, "b@1": 8, "c@2": 70}


def test_what_one_window_takes_back_is_gone(path: Path) -> None:
    settings, file = opened(path)
    settings.code = "ABC"
    file.save(settings)
    settings.code = ""
    file.save(settings)
    assert kept(path).code == ""


def test_a_window_that_has_changed_nothing_writes_nothing(path: Path) -> None:
    save_settings(Settings(name="ada"), path)
    settings, file = opened(path)
    before = path.stat()
    assert file.save(settings) == ""
    assert path.stat() == before


@pytest.mark.parametrize("content", [None, "{"])
def test_a_file_that_is_gone_or_broken_is_written_whole(path: Path, content: str | None) -> None:
    save_settings(Settings(name="ada"), path)
    settings, file = opened(path)
    path.unlink()
    if content is not None:
        path.write_text(content)
    settings.code = "ABC"
    assert file.save(settings) == ""
    assert kept(path) == Settings(name="ada", code="ABC")


def test_what_was_said_for_this_time_is_written_when_it_is_changed_or_asked_for(
    path: Path,
) -> None:
    before = Settings(name="ada", server="ws://usual")
    now = Settings(name="guest", server="ws://today")
    file = SettingsFile(path, now, before)
    file.save(now)
    assert kept(path) == before
    now.prefer(name="grace")
    file.save(now)
    assert kept(path).preferences.name == "grace"
    assert kept(path).preferences.server == "ws://usual"
    file.save(now, "server")
    assert kept(path).preferences.server == "ws://today"


def test_what_is_written_while_one_reads_is_read_anew(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_settings(Settings(), path)
    settings, file = opened(path)
    reads: list[Path] = []

    def read(file: Path) -> tuple[Settings, str]:
        found = load_settings(file)
        reads.append(file)
        if len(reads) == 1:
            save_settings(Settings(learned=True), file)
        return found

    monkeypatch.setattr(settings_module, "load_settings", read)
    settings.code = "ABC"
    assert file.save(settings) == ""
    assert len(reads) == 2
    assert kept(path) == Settings(code="ABC", learned=True)


def test_what_cannot_be_written_is_tried_again(path: Path) -> None:
    path.parent.joinpath("file").write_text("")
    there = path.parent / "file" / "window.json"
    settings, file = Settings(), SettingsFile(there, Settings())
    settings.code = "ABC"
    assert "cannot be saved" in file.save(settings)
    there.parent.unlink()
    assert file.save(settings) == ""
    assert kept(there).code == "ABC"
