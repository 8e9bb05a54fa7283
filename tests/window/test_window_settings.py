"""Settings file: damaged files, and several windows that share one."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from robotouille_client.window.app import settings as settings_module
from robotouille_client.window.app.settings import (
    Settings,
    SettingsFile,
    load_settings,
    save_settings,
)
from robotouille_client.window.preferences import Preferences


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", "Could not read"),
        ('{"version": 7}', "settings version 7"),
        ("[]", "settings version None"),
        ('{"version": 1, "rate": "fast"}', "Invalid settings: rate"),
        ('{"version": 1, "colour": "red"}', "Invalid settings: colour"),
        ('{"version": 1, "size": [NaN, 720]}', "Invalid settings: size"),
        ('{"version": 1, "text_scale": Infinity}', "Invalid settings: text_scale"),
        ("[" * 99_000, "Could not read"),
        (f'{{"version": "{"9" * 999}"}}', "settings version"),
        (" " * 100_001, "Settings file over"),
        ("\ud83d", "Could not read"),
    ],
)
def test_unreadable_settings_are_backed_up(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    settings, words = load_settings(path)
    assert settings == Settings()
    assert expected in words
    assert len(words) < 200
    assert "window.json.bak" in words
    kept = (tmp_path / "window.json.bak").read_text(encoding="utf-8", errors="surrogatepass")
    assert kept == text
    assert not path.exists()


@pytest.mark.parametrize("key", ["hat", "\\ud800", "\\u202e", "", "a\\nb"])
def test_valid_settings_count_next_to_invalid_ones(tmp_path: Path, key: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(f'{{"version": 1, "name": "ada", "rate": 900, "size": [1, 2], "{key}": "red"}}')
    settings, words = load_settings(path)
    assert settings == Settings(name="ada")
    assert "rate" in words
    assert "size" in words
    assert not save_settings(settings, path)
    assert load_settings(path) == (settings, "")


def test_settings_path_is_a_folder(tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.mkdir()
    settings, words = load_settings(path)
    assert settings == Settings()
    assert "Is a directory" in words
    assert "Could not save" in save_settings(settings, path)
    assert [each.name for each in tmp_path.iterdir()] == ["window.json"], "nothing is left over"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("link", [False, True])
def test_settings_path_is_a_pipe(tmp_path: Path, link: bool) -> None:
    path = tmp_path / "window.json"
    os.mkfifo(tmp_path / "pipe" if link else path)
    os.mkfifo(tmp_path / "window.json.part")
    if link:
        path.symlink_to(tmp_path / "pipe")
    settings, words = load_settings(path)
    assert settings == Settings()
    assert "not a file" in words
    assert "not a file" in save_settings(Settings(name="ada"), path)
    assert path.is_fifo()
    assert path.is_symlink() is link


def test_the_target_of_a_link_is_backed_up(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.json", tmp_path / "window.json"
    whole.write_text("{")
    path.symlink_to(whole)
    _, words = load_settings(path)
    assert words.endswith("The old file is whole.json.bak.")
    assert (tmp_path / "whole.json.bak").read_text() == "{"
    assert not save_settings(Settings(name="ada"), path)
    assert path.is_symlink()
    assert load_settings(whole)[0].preferences.name == "ada"


def test_preferences_are_on_the_top_level_of_the_file() -> None:
    plain = json.loads(Settings(code="ABC", name="ada").model_dump_json())
    assert plain.keys() >= {"version", "name", "keys", "code", "best"}
    assert plain["version"] == 1
    assert "preferences" not in plain
    again = Settings.model_validate(plain)
    assert (again.code, again.preferences) == ("ABC", Preferences(name="ada"))


def test_missing_settings_are_the_defaults(tmp_path: Path) -> None:
    assert load_settings(tmp_path / "none" / "window.json") == (Settings(), "")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "window.json"


def opened(path: Path) -> tuple[Settings, SettingsFile]:
    settings, _ = load_settings(path)
    return settings, SettingsFile(path, settings)


def kept(path: Path) -> Settings:
    settings, expected = load_settings(path)
    assert expected == ""
    return settings


def test_a_window_writes_only_its_changes(path: Path) -> None:
    save_settings(Settings(name="ada", code="OLD"), path)
    (one, first), (other, second) = opened(path), opened(path)
    one.code = "NEW"
    one.prefer(server="ws://there")
    assert first.save(one) == ""
    other.learned = True
    assert second.save(other) == ""
    assert second.save(other) == ""
    assert kept(path) == Settings(name="ada", code="NEW", server="ws://there", learned=True)


def test_the_addresses_of_a_cluster_are_kept(path: Path) -> None:
    nodes = ",".join(f"wss://node{number}.kitchen.lab.example.org" for number in range(9))
    settings, file = opened(path)
    settings.prefer(server=nodes)
    assert file.save(settings) == ""
    assert kept(path).preferences.server == nodes


def test_the_better_result_is_kept(path: Path) -> None:
    save_settings(Settings(best={"a@1": 50, "b@1": 9}, stars={"a@1": 1}), path)
    (one, first), (other, second) = opened(path), opened(path)
    one.best |= {"a@1": 30, "c@2": 70}
    one.stars |= {"a@1": 3}
    other.best |= {"a@1": 40, "b@1": 8}
    other.stars |= {"a@1": 2, "b@1": 1}
    assert first.save(one) == second.save(other) == ""
    assert kept(path).best == {"a@1": 30, "b@1": 8, "c@2": 70}
    assert kept(path).stars == {"a@1": 3, "b@1": 1}


def test_more_points_of_a_shift_are_better(path: Path) -> None:
    shift = "shifts/01_sandwich_bar@2"
    save_settings(Settings(best={shift: 224}), path)
    (one, first), (other, second) = opened(path), opened(path)
    one.best[shift], other.best[shift] = 367, 300
    assert first.save(one) == second.save(other) == ""
    assert kept(path).best == {shift: 367}


def test_a_removed_setting_stays_removed(path: Path) -> None:
    settings, file = opened(path)
    settings.code = "ABC"
    file.save(settings)
    settings.code = ""
    file.save(settings)
    assert kept(path).code == ""


def test_no_change_writes_nothing(path: Path) -> None:
    save_settings(Settings(name="ada"), path)
    settings, file = opened(path)
    before = path.stat()
    assert file.save(settings) == ""
    assert path.stat() == before


@pytest.mark.parametrize("content", [None, "{"])
def test_a_missing_or_damaged_file_is_written_whole(path: Path, content: str | None) -> None:
    save_settings(Settings(name="ada"), path)
    settings, file = opened(path)
    path.unlink()
    if content is not None:
        path.write_text(content)
    settings.code = "ABC"
    assert file.save(settings) == ""
    assert kept(path) == Settings(name="ada", code="ABC")


def test_options_of_one_run_are_saved_when_changed(path: Path) -> None:
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


def test_a_concurrent_write_is_merged(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_a_failed_write_is_retried(path: Path) -> None:
    path.parent.joinpath("file").write_text("")
    there = path.parent / "file" / "window.json"
    settings, file = Settings(), SettingsFile(there, Settings())
    settings.code = "ABC"
    assert "Could not save" in file.save(settings)
    there.parent.unlink()
    assert file.save(settings) == ""
    assert kept(there).code == "ABC"
