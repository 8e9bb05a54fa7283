"""The file of settings: whatever it holds, a window opens, and what was sound stays."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from pydantic import ValidationError

from robotouille_client.window.preferences import Preferences
from robotouille_client.window.shell.settings import (
    Settings,
    load_settings,
    save_settings,
)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{", "cannot be read"),
        ('{"version": 7}', "are of version 7"),
        ("[]", "are of version None"),
        ('{"version": 1, "rate": "fast"}', "cannot be read"),
        ('{"version": 1, "colour": "red"}', "cannot be read as to colour"),
        ('{"version": 1, "size": [NaN, 720]}', "cannot be read as to size"),
        ('{"version": 1, "text_scale": Infinity}', "cannot be read as to text_scale"),
        ("[" * 99_000, "cannot be read"),
        (f'{{"version": "{"9" * 999}"}}', "are of version"),
        (" " * 100_001, "are longer than"),
        ("\ud83d", "cannot be read"),
    ],
)
def test_settings_that_cannot_be_read_are_kept_beside(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    settings, words = load_settings(path)
    assert settings == Settings()
    assert told in words
    assert len(words) < 200
    assert "window.json.bak" in words
    kept = (tmp_path / "window.json.bak").read_text(encoding="utf-8", errors="surrogatepass")
    assert kept == text
    assert not path.exists()


def test_of_settings_that_are_wrong_in_part_the_others_count(tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.write_text('{"version": 1, "name": "ada", "rate": 900, "size": [1, 2], "hat": "red"}')
    settings, words = load_settings(path)
    assert settings == Settings(name="ada")
    for name in ("rate", "size", "hat"):
        assert name in words
    assert not save_settings(settings, path)
    assert load_settings(path) == (settings, "")


def test_settings_that_are_a_folder(tmp_path: Path) -> None:
    path = tmp_path / "window.json"
    path.mkdir()
    settings, words = load_settings(path)
    assert settings == Settings()
    assert "Is a directory" in words
    assert "cannot be saved" in save_settings(settings, path)
    assert [each.name for each in tmp_path.iterdir()] == ["window.json"], "nothing is left over"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
def test_settings_that_are_a_pipe(tmp_path: Path) -> None:
    """Whoever opens one waits for its other end."""
    path = tmp_path / "window.json"
    os.mkfifo(path)
    os.mkfifo(tmp_path / "window.json.part")
    settings, words = load_settings(path)
    assert settings == Settings()
    assert "no file" in words
    assert "no file" in save_settings(Settings(name="ada"), path)
    assert path.is_fifo()


@pytest.mark.parametrize("key", ["\\ud800", "\\u202e", "", "a\\nb"])
def test_a_setting_with_any_name_is_left_out(tmp_path: Path, key: str) -> None:
    path = tmp_path / "window.json"
    path.write_text(f'{{"version": 1, "name": "ada", "rate": 900, "{key}": 1}}')
    settings, words = load_settings(path)
    assert settings == Settings(name="ada")
    assert "rate" in words


def test_a_link_to_settings_stays_one(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.json", tmp_path / "window.json"
    path.symlink_to(whole)
    assert not save_settings(Settings(name="ada"), path)
    assert path.is_symlink()
    assert load_settings(whole)[0].preferences.name == "ada"


def test_of_a_link_to_a_broken_file_the_file_is_kept_beside(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.json", tmp_path / "window.json"
    whole.write_text("{")
    path.symlink_to(whole)
    _, words = load_settings(path)
    assert words.endswith("The old file is whole.json.bak.")
    assert (tmp_path / "whole.json.bak").read_text() == "{"
    assert not save_settings(Settings(name="ada"), path)
    assert path.is_symlink()
    assert load_settings(whole)[0].preferences.name == "ada"


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    pipe, path = tmp_path / "pipe", tmp_path / "window.json"
    os.mkfifo(pipe)
    path.symlink_to(pipe)
    assert "no file" in save_settings(Settings(name="ada"), path)
    assert pipe.is_fifo()
    assert path.is_symlink()


def test_two_windows_do_not_write_into_one_draft(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, drafts = tmp_path / "window.json", []
    replace = Path.replace

    def other_first(draft: Path, target: Path) -> Path:
        drafts.append(draft)
        if len(drafts) == 1:
            monkeypatch.setattr(os, "getpid", lambda: 1)
            assert not save_settings(Settings(name="bob"), path)
        return replace(draft, target)

    monkeypatch.setattr(Path, "replace", other_first)
    assert not save_settings(Settings(name="ada"), path)
    assert len(set(drafts)) == 2
    assert load_settings(path)[0].preferences.name == "ada"
    assert [each.name for each in tmp_path.iterdir()] == ["window.json"]


def test_preferences_stand_among_the_others_in_the_file() -> None:
    plain = json.loads(Settings(code="ABC", name="ada").model_dump_json())
    assert plain.keys() >= {"version", "name", "keys", "code", "best"}
    assert "preferences" not in plain
    again = Settings.model_validate(plain)
    assert (again.code, again.preferences) == ("ABC", Preferences(name="ada"))


def test_preferences_give_way_to_others_and_never_change() -> None:
    settings = Settings()
    before = settings.preferences
    settings.prefer(keys={"use": ["f"]})
    assert before == Preferences()
    assert settings.preferences.keys == {"use": ["f"]}
    with pytest.raises(ValidationError):
        before.sound = False  # type: ignore[misc]


def test_no_settings_are_the_defaults(tmp_path: Path) -> None:
    assert load_settings(tmp_path / "none" / "window.json") == (Settings(), "")


def test_the_settings_file_says_its_version(tmp_path: Path) -> None:
    assert json.loads(Settings().model_dump_json())["version"] == 1
