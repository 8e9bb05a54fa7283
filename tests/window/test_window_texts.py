"""Words that are made of values."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille_client.window.sources.texts import clock_words, path_words, rate_words


@pytest.mark.parametrize(
    ("rate", "words"),
    [(1.0, "1 step a second"), (5.0, "5 steps a second"), (0.5, "0.5 steps a second")],
)
def test_one_step_is_one(rate: float, words: str) -> None:
    assert rate_words(rate) == words
    assert clock_words("realtime", {"step_rate": rate}) == f"real time, {words}"


def test_a_path_in_ones_own_folder_begins_with_a_tilde(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    assert path_words(tmp_path / "a" / "b.png") == "~/a/b.png"
    assert path_words(tmp_path.parent / "b.png") == str(tmp_path.parent / "b.png")
