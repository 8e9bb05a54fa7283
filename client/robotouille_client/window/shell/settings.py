"""What the window remembers of its owner: a JSON file in the user's own folder for settings."""

from __future__ import annotations

import contextlib
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

from robotouille_client.window.preferences import Preferences, Word

__all__ = ["Settings", "SettingsFile", "load_settings", "save_settings", "settings_path"]

VERSION = 1
MAX_BYTES = 100_000
"""Of the file: nobody has so many settings."""
TRIES = 3
"""How often another window may write meanwhile, before this one writes nevertheless."""


class Settings(BaseModel):
    """All that is remembered: what the window's owner prefers, and what was done last.

    `task`, `partner` and `rate` (steps a second) were played last, `code` was joined last. `best`
    has the fewest steps in which each task was done here, by `NAME@PLAYERS`. In the file the
    preferences stand among the others.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    version: int = VERSION
    preferences: Preferences = Preferences()
    task: Annotated[str, Field(max_length=200)] = "synchronous/01"
    seats: Annotated[int, Field(ge=1, le=8)] = 1
    partner: Word = "planner"
    rate: Annotated[float, Field(ge=1, le=20)] = 5.0
    code: Word = ""
    learned: bool = False
    best: dict[str, Annotated[int, Field(ge=0)]] = Field(default={}, max_length=1000)

    def prefer(self, **changes: object) -> None:
        """Prefer something else from now on."""
        self.preferences = self.preferences.model_copy(update=changes)

    @model_validator(mode="before")
    @classmethod
    def _gather(cls, plain: dict[str, Any]) -> dict[str, Any]:
        """The preferences as a value of their own."""
        preferred = {name: plain[name] for name in plain if name in Preferences.model_fields}
        if not preferred:
            return plain
        others = {name: value for name, value in plain.items() if name not in preferred}
        return {**others, "preferences": preferred}

    @model_serializer(mode="wrap")
    def _scatter(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The preferences among the others."""
        plain = serialize(self)
        return {**plain.pop("preferences"), **plain}


def settings_path() -> Path:
    """Where the settings are."""
    from platformdirs import user_config_path

    return user_config_path("robotouille") / "window.json"


def load_settings(path: Path) -> tuple[Settings, str]:
    """The settings, and words where they could not be read.

    A file that is broken or of another version is kept beside, as `….bak`, and the defaults are
    taken; of one with settings that are wrong, or not known, the others.
    """
    try:
        if not (path.is_file() or path.is_dir() or not path.exists()):
            return Settings(), "The settings are no file: these are the defaults."
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            return Settings(), _set_aside(path, f"are longer than {MAX_BYTES:,} bytes")
        raw: Any = json.loads(content)
        version = raw.get("version") if isinstance(raw, dict) else None
        if version != VERSION:
            return Settings(), _set_aside(path, f"are of version {str(version)[:20]}")
    except FileNotFoundError:
        return Settings(), ""
    except (ValueError, RecursionError):
        return Settings(), _set_aside(path, "cannot be read")
    except OSError as error:
        return Settings(), f"The settings cannot be read: {error.strerror}."
    return _sound(raw, path)


def _sound(raw: dict[str, Any], path: Path) -> tuple[Settings, str]:
    """The settings without those that make no sense, and words where there are such."""
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
    return settings, _set_aside(path, f"cannot be read as to {names}", "these are left out")


def save_settings(settings: Settings, path: Path) -> str:
    """Write the settings; words where that fails, which is no reason to stop.

    A link to a file stays one, and what is no file stays what it is. Of two windows the last one
    counts, and neither writes into the other's draft.
    """
    whole = Path(os.path.realpath(path))
    if whole.exists() and not whole.is_file():
        return "The settings cannot be saved: their place is taken by what is no file."
    draft = whole.with_name(f"{whole.name}.{os.getpid()}.part")
    try:
        whole.parent.mkdir(parents=True, exist_ok=True)
        draft.unlink(missing_ok=True)
        with draft.open("x", encoding="utf-8") as file:
            file.write(settings.model_dump_json(indent=2) + "\n")
        draft.replace(whole)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        return f"The settings cannot be saved: {error.strerror}."
    return ""


class SettingsFile:
    """What this window changes is laid over what stands in the file by then: the windows of one
    person share it, and none takes back what another one has remembered.

    Args:
        settings: As they are now.
        kept: As they stand in the file, where they differ: what was said for this time only is not
            written, unless it is changed. It is what a file that is gone is written from.
    """

    def __init__(self, path: Path, settings: Settings, kept: Settings | None = None) -> None:
        self._path = path
        self._known = settings.model_dump()
        self._kept = (kept or settings).model_dump()

    def save(self, settings: Settings, *always: str) -> str:
        """Write what has changed since the last time, and the settings named `always`; words where
        that fails, which is no reason to stop."""
        now = settings.model_dump()
        changes = {
            name: value
            for name, value in now.items()
            if name in always or value != self._known[name]
        }
        if not changes and self._path.exists():
            return ""
        told = self._lay_over(changes)
        if not told:
            self._known |= changes
            self._kept |= changes
        return told

    def _lay_over(self, changes: dict[str, Any]) -> str:
        for _ in range(TRIES):
            before = self._stamp()
            merged = Settings.model_validate(_merged(self._standing(), changes))
            if self._stamp() == before:
                break
        return save_settings(merged, self._path)

    def _standing(self) -> dict[str, Any]:
        """What stands in the file; of one that is gone or cannot be read, what it had."""
        if not self._path.exists():
            return self._kept
        found, told = load_settings(self._path)
        return self._kept if told and found == Settings() else found.model_dump()

    def _stamp(self) -> tuple[int, int] | None:
        """What is another after each writing, which replaces the file."""
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_ino, found.st_mtime_ns


def _set_aside(path: Path, what: str, instead: str = "these are the defaults") -> str:
    """Keep the file, or what a link leads to, beside."""
    whole = Path(os.path.realpath(path))
    beside = whole.with_name(f"{whole.name}.bak")
    try:
        whole.replace(beside)
    except OSError:
        return f"The settings {what}: {instead}."
    return f"The settings {what}: {instead}. The old file is {beside.name}."


def _merged(standing: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Of the best games of both, the better ones."""
    merged = {**standing, **changes}
    best = dict(standing["best"])
    for task, steps in changes.get("best", {}).items():
        best[task] = min(best.get(task, steps), steps)
    return {**merged, "best": best}
