"""The settings, each of which counts at once, and which key does what."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from robotouille.domain.companions import other_renderings
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.text_field import TextField
from robotouille_client.window.forms.widgets import Button, Choice, KeyField, Row, Slider
from robotouille_client.window.hands.commands import DEFAULT_KEYS, Command, KeyMap
from robotouille_client.window.shell.settings import Settings

__all__ = ["KeysMenu", "SettingsMenu"]

_WORDS = {
    Command.LEFT: "Walk left",
    Command.RIGHT: "Walk right",
    Command.UP: "Walk up",
    Command.DOWN: "Walk down",
    Command.USE: "Use what is here",
    Command.LIST: "List of all actions",
    Command.CHAT: "Say something",
    Command.HELP: "Help",
    Command.SOUND: "Sound on or off",
    Command.FULLSCREEN: "Fill the screen",
    Command.SCREENSHOT: "Save a picture",
}
_AT_ONCE = "What you change counts at once."
_FIXED = "Arrows always walk, Enter always does what has the focus."


class SettingsMenu:
    """A form that changes preferences as it is used.

    `changed` is told the name of each that was changed, and says what is wrong with it, if
    anything is.
    """

    def __init__(
        self, settings: Settings, changed: Callable[[str], str] = lambda field: ""
    ) -> None:
        self._settings = settings
        self._changed = changed
        self.keys = Button("Keys", "keys")
        looks = [("as it comes", ""), *((name, name) for name in other_renderings())]
        contrasts = [("as usual", False), ("strong contrast", True)]
        motion = [("all", False), ("only what matters", True)]
        rows = (
            self._text("name", "Your name", 40),
            self._text("server", "Server", 200),
            self._choice("rendering", "Look", looks),
            self._choice("strong_contrast", "Colours", contrasts),
            self._choice("sound", "Sound", [("on", True), ("off", False)]),
            self._choice("reduced_motion", "What moves", motion),
            self._choice("fullscreen", "Fill the screen", [("no", False), ("yes", True)]),
            Slider(
                "Size of letters", settings.preferences.text_scale, 0.8, 1.6, 0.1,
                lambda x: f"{round(x * 100)} %", lambda scale: self._set("text_scale", scale),
            ),
            self._text("language_file", "Language file", 400, "words of your own: a JSON file"),
            self.keys,
            Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Settings", rows, pinned=1)
        self.form.message = _AT_ONCE

    def _text(self, field: str, label: str, length: int, may_be_empty: str = "") -> TextField:
        def changed(text: str) -> None:
            if text.strip() or may_be_empty:
                self._set(field, text.strip())

        value = str(getattr(self._settings.preferences, field))
        return TextField(label, value, length, may_be_empty, changed)

    def _choice(self, field: str, label: str, options: Sequence[tuple[str, object]]) -> Choice:
        value = getattr(self._settings.preferences, field)
        return Choice(label, options, value, lambda new: self._set(field, new))

    def _set(self, field: str, value: object) -> None:
        self._settings.prefer(**{field: value})
        self.form.message = self._changed(field) or _AT_ONCE


class KeysMenu:
    """The keys that can be changed; a key that meant something else means that no more.

    `changed` is told the new ones.
    """

    def __init__(self, keys: KeyMap, changed: Callable[[KeyMap], None] = lambda keys: None) -> None:
        self.keys = keys
        self._changed = changed
        self._fields = {
            command: KeyField(_WORDS[command], "", self._changer(command))
            for command in DEFAULT_KEYS
        }
        reset = _Pressed("As they were", lambda: self._take(KeyMap()))
        rows: list[Row] = [*self._fields.values(), reset, Button("Back", "back")]
        self.form = Form("Keys", rows, pinned=1)
        self.form.message = _FIXED
        self._show()

    def _changer(self, command: Command) -> Callable[[str], None]:
        return lambda key: self._take(self.keys.with_key(command, key))

    def _take(self, keys: KeyMap) -> None:
        lost = [
            _WORDS[command]
            for command in DEFAULT_KEYS
            if self.keys.keys(command) and not keys.keys(command)
        ]
        self.keys = keys
        self._show()
        self.form.message = f"No key any more: {', '.join(lost)}." if lost else _FIXED
        self._changed(keys)

    def _show(self) -> None:
        for command, field in self._fields.items():
            keys = self.keys.keys(command)
            field.current = keys[0] if keys else ""


class _Pressed(Row):
    """Does something, and the form stays."""

    def __init__(self, label: str, does: Callable[[], None]) -> None:
        super().__init__(label)
        self._does = does

    def command(self, command: Command) -> bool:
        if command in (Command.USE, Command.ENTER):
            self._does()
        return False
