"""The window's settings, kept in a JSON file in the user's folder for settings."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from robotouille.files.writing import replace_file
from robotouille_client.window.preferences import Preferences, Word

VERSION = 1
MAX_BYTES = 100_000
"""Largest settings file that is read."""
SHIFTS = "shifts"
"""Family of the tasks with points. More points are better, but fewer steps are in other tasks."""
TRIES = 3
"""Number of attempts to merge with another window's changes before overwriting them."""


class Settings(BaseModel):
    """Everything the window remembers: preferences and the last choices.

    In the file, the preferences are on the same level as the other settings.

    Attributes:
        rate: Steps per second of the last game.
        code: Code of the last kitchen that was joined.
        learned: True if the player has finished the tutorial.
        best: Fewest steps, or most points of a shift, by `NAME@PLAYERS` of each task.
        stars: Most stars by `NAME@PLAYERS` of each task.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    version: int = VERSION
    preferences: Preferences = Preferences()
    task: Annotated[str, Field(max_length=200)] = "synchronous/01"
    seats: Annotated[int, Field(ge=1, le=8)] = 1
    partner: Word = "partner"
    rate: Annotated[float, Field(ge=1, le=20)] = 5.0
    code: Word = ""
    learned: bool = False
    best: dict[str, Annotated[int, Field(ge=0)]] = Field(default={}, max_length=1000)
    stars: dict[str, Annotated[int, Field(ge=0, le=3)]] = Field(default={}, max_length=1000)

    def prefer(self, **changes: object) -> None:
        """Change preferences."""
        self.preferences = self.preferences.model_copy(update=changes)

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, plain: dict[str, Any]) -> dict[str, Any]:
        """Move the preferences into a value of their own."""
        preferred = {name: plain[name] for name in plain if name in Preferences.model_fields}
        if not preferred:
            return plain
        others = {name: value for name, value in plain.items() if name not in preferred}
        return {**others, "preferences": preferred}

    @model_serializer(mode="wrap")
    def _scatter(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Move the preferences to the level of the other settings."""
        plain = serialize(self)
        return {**plain.pop("preferences"), **plain}


def settings_path() -> Path:
    from platformdirs import user_config_path

    return user_config_path("robotouille") / "window.json"


def load_settings(path: Path) -> tuple[Settings, str]:
    """Return the settings, and a message if they could not be read.

    A file that is damaged or of another version is renamed to `….bak`, and the defaults are used.
    Invalid or unknown settings are ignored.
    """
    try:
        if not (path.is_file() or path.is_dir() or not path.exists()):
            return Settings(), "The settings are not a file. Using the defaults."
        # The limit applies to what is read, because a file can grow after its size was checked.
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            return Settings(), _set_aside(path, f"Settings file over {MAX_BYTES:,} bytes.")
        raw: Any = json.loads(content)
        version = raw.get("version") if isinstance(raw, dict) else None
        if version != VERSION:
            return Settings(), _set_aside(path, f"Unknown settings version {str(version)[:20]}.")
    except FileNotFoundError:
        return Settings(), ""
    except (ValueError, RecursionError):
        return Settings(), _set_aside(path, "Could not read the settings.")
    except OSError as error:
        return Settings(), f"Could not read the settings: {error.strerror}."
    return _sound(raw, path)


def _sound(raw: dict[str, Any], path: Path) -> tuple[Settings, str]:
    """Return the valid settings, and a message if there are invalid ones."""
    known = (Settings.model_fields | Preferences.model_fields).keys() - {"preferences"}
    wrong = [name for name in raw if name not in known]
    kept = {name: value for name, value in raw.items() if name in known}
    try:
        settings = Settings.model_validate(kept)
    except ValidationError as error:
        places = (fault["loc"] for fault in error.errors())
        faulty = dict.fromkeys(str(at[1] if at[0] == "preferences" else at[0]) for at in places)
        wrong = [*faulty, *wrong]
        sound = {name: value for name, value in kept.items() if name not in faulty}
        settings = Settings.model_validate(sound)
    if not wrong:
        return settings, ""
    names = ", ".join(name[:20] for name in wrong[:4]) + (", …" if len(wrong) > 4 else "")
    return settings, _set_aside(path, f"Invalid settings: {names}.", "Ignoring these.")


def save_settings(settings: Settings, path: Path) -> str:
    """Write the settings; return a message if that fails.

    A link to a file stays a link. If two windows write at the same time, the last one wins; each
    writes a draft of its own first.
    """
    whole = Path(os.path.realpath(path))
    if whole.exists() and not whole.is_file():
        return "Could not save the settings: the path is not a file."
    try:
        whole.parent.mkdir(parents=True, exist_ok=True)
        # Replacing the file at once means that a crash leaves either the old or the new settings.
        replace_file(whole, settings.model_dump_json(indent=2) + "\n")
    except OSError as error:
        return f"Could not save the settings: {error.strerror}."
    return ""


class SettingsFile:
    """Settings file shared by several windows. Each window writes only what it has changed itself.

    Args:
        settings: Current settings.
        kept: Settings in the file, if they differ. Options of the command line are not saved unless
            the player changes them.
    """

    def __init__(self, path: Path, settings: Settings, kept: Settings | None = None) -> None:
        self._path = path
        self._known = settings.model_dump()
        self._kept = (kept or settings).model_dump()

    def save(self, settings: Settings, *always: str) -> str:
        """Write the changes since the last time, and the settings named `always`.

        Return a message if that fails; the window goes on.
        """
        now = settings.model_dump()
        changes = {
            name: value
            for name, value in now.items()
            if name in always or value != self._known[name]
        }
        if not changes and self._path.exists():
            return ""
        fault = self._merge(changes)
        if not fault:
            self._known |= changes
            self._kept |= changes
        return fault

    def _merge(self, changes: dict[str, Any]) -> str:
        # Another window may write between reading and writing; its changes would get lost.
        for _ in range(TRIES):
            before = self._stamp()
            merged = Settings.model_validate(_merged(self._saved(), changes))
            if self._stamp() == before:
                break
        return save_settings(merged, self._path)

    def _saved(self) -> dict[str, Any]:
        """Return the settings in the file, or those it had if it is missing or unreadable."""
        if not self._path.exists():
            return self._kept
        found, fault = load_settings(self._path)
        return self._kept if fault and found == Settings() else found.model_dump()

    def _stamp(self) -> tuple[int, int] | None:
        """Return a value that differs after each write, because writing replaces the file."""
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns


def _set_aside(path: Path, fault: str, instead: str = "Using the defaults.") -> str:
    """Rename the file, or the target of a link, to `….bak`; return a message."""
    whole = Path(os.path.realpath(path))
    backup = whole.with_name(f"{whole.name}.bak")
    try:
        whole.replace(backup)
    except OSError:
        return f"{fault} {instead}"
    return f"{fault} {instead} The old file is {backup.name}."


def is_shift(task: str) -> bool:
    """Return whether a task, as `NAME` or `NAME@PLAYERS`, has points instead of steps."""
    return task.startswith(f"{SHIFTS}/")


def _merged(saved: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return the saved settings with this window's changes.

    Another window may have saved a better result for the same task, which stays.
    """
    best, stars = dict(saved["best"]), dict(saved["stars"])
    for task, result in changes.get("best", {}).items():
        better = max if is_shift(task) else min
        best[task] = better(best.get(task, result), result)
    for task, earned in changes.get("stars", {}).items():
        stars[task] = max(stars.get(task, earned), earned)
    return {**saved, **changes, "best": best, "stars": stars}
