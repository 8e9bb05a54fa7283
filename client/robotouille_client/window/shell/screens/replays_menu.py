"""The newest recordings that are here."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Row, Words

__all__ = ["recent_recordings", "replays_menu"]

SHOWN = 30


def recent_recordings(folders: Iterable[Path]) -> list[Path]:
    """Recordings in some folders, the newest first."""
    found: list[tuple[float, Path]] = []
    for folder in folders:
        for path in folder.glob("*.rbt") if folder.is_dir() else ():
            try:
                found.append((path.stat().st_mtime, path))
            except OSError:
                continue
    return [path for _, path in sorted(found, reverse=True)[:SHOWN]]


def replays_menu(paths: Iterable[Path], message: str = "") -> Form:
    """A form whose result is a path."""
    rows: list[Row] = [Button(path.stem.replace("_", " "), path) for path in paths]
    if not rows:
        rows.append(Words("There is no recording yet: play a game first."))
    form = Form("Replays", [*rows, Button("Back", "back")])
    form.message = message
    return form
