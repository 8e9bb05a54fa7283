"""The settings, and which key does what."""

from __future__ import annotations

from robotouille.domain.companions import other_renderings
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Choice, KeyField, Row, Slider, TextField
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


class SettingsMenu:
    """The form, and what was set in it."""

    def __init__(self, settings: Settings) -> None:
        self._name = TextField("Your name", settings.name, 40)
        self._server = TextField("Server", settings.server, 200)
        self._full = Choice("Fill the screen", [("no", False), ("yes", True)], settings.fullscreen)
        self._scale = Slider(
            "Size of letters", settings.text_scale, 0.8, 1.6, 0.1, lambda x: f"{round(x * 100)} %"
        )
        looks = [("as it comes", ""), *((name, name) for name in other_renderings())]
        self._rendering = Choice("Look", looks, settings.rendering)
        self._sound = Choice("Sound", [("on", True), ("off", False)], settings.sound)
        motion = [("all", False), ("only what matters", True)]
        self._motion = Choice("What moves", motion, settings.reduced_motion)
        rows = (
            self._name, self._server, self._rendering, self._sound, self._motion,
            self._full, self._scale, Button("Keys", "keys"), Button("Save", "save"),
            Button("Back", "back"),
        )  # fmt: skip
        self.form = Form("Settings", rows)

    def apply(self, settings: Settings) -> None:
        """Take over what was set."""
        settings.name = self._name.text.strip() or settings.name
        settings.server = self._server.text.strip() or settings.server
        settings.reduced_motion = bool(self._motion.value)
        settings.rendering = str(self._rendering.value)
        settings.sound = bool(self._sound.value)
        settings.fullscreen = bool(self._full.value)
        settings.text_scale = self._scale.value


class KeysMenu:
    """The keys that can be changed; a key that meant something else means that no more."""

    def __init__(self, keys: KeyMap) -> None:
        self.keys = keys
        self._fields = {
            command: KeyField(_WORDS[command], self._key(command), self._changer(command))
            for command in DEFAULT_KEYS
        }
        rows: list[Row] = [*self._fields.values(), Button("As they were", "reset")]
        self.form = Form("Keys", [*rows, Button("Save", "save"), Button("Back", "back")])
        self.form.message = "Arrows always walk, Enter always does what has the focus."

    def _key(self, command: Command) -> str:
        keys = self.keys.keys(command)
        return keys[0] if keys else ""

    def _changer(self, command: Command):  # type: ignore[no-untyped-def]
        def change(key: str) -> None:
            self.keys = self.keys.with_key(command, key)
            for other, field in self._fields.items():
                field.current = self._key(other)

        return change
