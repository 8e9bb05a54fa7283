"""What the window's own keys mean, and which keys these are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum

__all__ = ["DEFAULT_KEYS", "DIRECTIONS", "FIXED", "Command", "KeyMap", "key_words"]


class Command(StrEnum):
    """What a key of the window, or a button of a gamepad, asks for."""

    LEFT = "left"
    RIGHT = "right"
    UP = "up"
    DOWN = "down"
    USE = "use"
    LIST = "list"
    CANCEL = "cancel"
    ENTER = "enter"
    CHAT = "chat"
    HELP = "help"
    FULLSCREEN = "fullscreen"
    SCREENSHOT = "screenshot"
    MENU = "menu"
    SOUND = "sound"


DIRECTIONS: Mapping[Command, tuple[int, int]] = {
    Command.LEFT: (-1, 0),
    Command.RIGHT: (1, 0),
    Command.UP: (0, 1),
    Command.DOWN: (0, -1),
}
"""The unit vector of each direction; y points up, as in problem files."""

DEFAULT_KEYS: Mapping[Command, tuple[str, ...]] = {
    Command.LEFT: ("a",),
    Command.RIGHT: ("d",),
    Command.UP: ("w",),
    Command.DOWN: ("s",),
    Command.USE: ("e", "space"),
    Command.LIST: ("tab",),
    Command.CHAT: ("t",),
    Command.HELP: ("h",),
    Command.SOUND: ("m",),
    Command.FULLSCREEN: ("f11",),
    Command.SCREENSHOT: ("f12",),
}
"""What the owner of a window may change."""

FIXED: Mapping[str, Command] = {
    "left": Command.LEFT,
    "right": Command.RIGHT,
    "up": Command.UP,
    "down": Command.DOWN,
    "escape": Command.CANCEL,
    "esc": Command.CANCEL,
    "return": Command.ENTER,
    "enter": Command.ENTER,
}
"""Keys that mean the same for everybody, so that nobody can lock themselves out; `esc` and `enter`
are also what they are called where they are shown, and clicked."""

_SHORT = {"return": "Enter", "escape": "Esc"}


class KeyMap:
    """Which key means which command: the defaults, but for what its owner has changed."""

    def __init__(self, changed: Mapping[str, Iterable[str]] | None = None) -> None:
        self._keys = {**DEFAULT_KEYS}
        for name, keys in (changed or {}).items():
            if name in set(DEFAULT_KEYS):
                self._keys[Command(name)] = tuple(k.casefold() for k in keys if k not in FIXED)
        self._meaning = {key: command for command, keys in self._keys.items() for key in keys}

    def command(self, key: str) -> Command | None:
        """What a key means; None where it means nothing."""
        return FIXED.get(key) or self._meaning.get(key)

    def keys(self, command: Command) -> tuple[str, ...]:
        """The keys of a command that can be changed."""
        return self._keys.get(command, ())

    def words(self, command: Command) -> str:
        """The first key of a command as it is shown; empty where it has none."""
        keys = self.keys(command)
        return key_words(keys[0]) if keys else ""

    def with_key(self, command: Command, key: str) -> KeyMap:
        """The same but for the key of one command, which all others lose."""
        changed = {c.value: tuple(k for k in keys if k != key) for c, keys in self._keys.items()}
        changed[command.value] = (key,)
        return KeyMap(changed)

    @property
    def changed(self) -> dict[str, list[str]]:
        """What differs from the defaults."""
        return {c.value: list(k) for c, k in self._keys.items() if k != DEFAULT_KEYS[c]}


def key_words(key: str) -> str:
    """A key's name as it is shown: `E`, `Space`, `F11`."""
    short = len(key) == 1 or key[1:].isdigit()
    return _SHORT.get(key) or (key.upper() if short else key.capitalize())
