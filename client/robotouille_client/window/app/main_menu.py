"""Main menu and settings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import pygame

from robotouille.domain.related_files import other_renderings
from robotouille.installation import data_folder
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.forms.form import Form, FormLayout
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Button, Choice, KeyField, Row, Slider, TextField
from robotouille_client.window.input.commands import DEFAULT_KEYS, Command, KeyMap
from robotouille_client.window.preferences import MAX_SERVER

EMBLEM = ("assets", "kitchen", "app_icon.svg")


def main_menu(settings: Settings, message: str = "", chosen: object = None) -> Form:
    """Return the main menu.

    The last entry that was `chosen` has the focus. For new players it is the tutorial, which is
    never the first choice again once it is finished.
    """
    rows = [
        Button("Levels", MenuChoice.LEVELS),
        Button("Play here", MenuChoice.PLAY),
        Button("Join with a code", MenuChoice.JOIN),
        Button("Open a kitchen", MenuChoice.OPEN),
        Button("Find a kitchen", MenuChoice.LOBBY),
        Button("Replays", MenuChoice.REPLAYS),
        Button("Tutorial (two minutes)", MenuChoice.TUTORIAL),
        Button("Settings", MenuChoice.SETTINGS),
        Button("Quit", MenuChoice.QUIT),
    ]
    form = Form(
        f"Hello, {settings.preferences.name}!",
        rows,
        cancel=MenuChoice.ASK_TO_QUIT,
        layout=FormLayout(picture=_emblem),
    )
    if chosen == MenuChoice.TUTORIAL and settings.learned:
        chosen = MenuChoice.LEVELS
    last = next((row for row in rows if row.answer == chosen), None)
    if last is not None:
        form.focus(last)
    elif not settings.learned:
        form.focus(next(row for row in rows if row.answer == MenuChoice.TUTORIAL))
    form.message = message
    return form


def quit_form() -> Form:
    """Return the form that confirms quitting."""
    return Form(
        "Quit Robotouille?", [Button("Stay", MenuChoice.STAY), Button("Quit", MenuChoice.QUIT)]
    )


# The menu is drawn again for each input, but the emblem changes only with the window's size.
@lru_cache(maxsize=4)
def _emblem(room: tuple[int, int]) -> pygame.Surface | None:
    folder, kitchen, file = EMBLEM
    try:
        return pygame.image.load_sized_svg(data_folder(folder) / kitchen / file, (min(room),) * 2)
    # The menu must open even if the installation is incomplete.
    except (pygame.error, OSError):
        return None


_WORDS = {
    Command.LEFT: "Walk left",
    Command.RIGHT: "Walk right",
    Command.UP: "Walk up",
    Command.DOWN: "Walk down",
    Command.USE: "Use",
    Command.LIST: "List actions",
    Command.CHAT: "Chat",
    Command.HELP: "Help",
    Command.SOUND: "Sound on or off",
    Command.NEED: "I need this",
    Command.YOURS: "You take this",
    Command.LOOK: "Look here",
    Command.WAIT: "Wait",
    Command.THANKS: "Thank you",
    Command.FULLSCREEN: "Full screen",
    Command.SCREENSHOT: "Screenshot",
}
_AT_ONCE = "Changes apply at once."
_FIXED = "The arrow keys always walk. Enter always selects."


class SettingsMenu:
    """Settings, applied as they are changed.

    Args:
        changed: Function that receives the name of a changed setting, and returns what is wrong
            with it or "".
    """

    def __init__(
        self, settings: Settings, changed: Callable[[str], str] = lambda field: ""
    ) -> None:
        self._settings = settings
        self._changed = changed
        self.keys = Button("Keys", "keys")
        looks = [("default", ""), *((name, name) for name in other_renderings())]
        contrasts = [("normal", False), ("high", True)]
        motion = [("full", False), ("reduced", True)]
        rows = (
            self._text("name", "Your name", 40),
            self._text("server", "Server", MAX_SERVER),
            self._choice("rendering", "Look", looks),
            self._choice("strong_contrast", "Contrast", contrasts),
            self._choice("sound", "Sound", [("on", True), ("off", False)]),
            self._share("volume", "Volume of sounds"),
            self._share("music", "Volume of music"),
            self._choice("reduced_motion", "Animation", motion),
            self._choice("fullscreen", "Full screen", [("off", False), ("on", True)]),
            Slider(
                "Text size", settings.preferences.text_scale, 0.8, 1.6, 0.1,
                lambda x: f"{round(x * 100)} %", lambda scale: self._set("text_scale", scale),
            ),
            self._text("language_file", "Language file", 400, "JSON file with your own words"),
            self.keys,
            Button("Back", "back"),
        )  # fmt: skip
        # In small windows the settings scroll, but "Back" stays visible.
        self.form = Form("Settings", rows, layout=FormLayout(pinned=1))
        self.form.message = _AT_ONCE

    def _text(self, field: str, label: str, length: int, may_be_empty: str = "") -> TextField:
        def changed(text: str) -> None:
            if text.strip() or may_be_empty:
                self._set(field, text.strip())

        value = str(getattr(self._settings.preferences, field))
        return TextField(label, value, length, may_be_empty, changed)

    def _share(self, field: str, label: str) -> Slider:
        value = float(getattr(self._settings.preferences, field))
        return Slider(
            label, value, 0.0, 1.0, 0.1,
            lambda x: f"{round(x * 100)} %", lambda share: self._set(field, share),
        )  # fmt: skip

    def _choice(self, field: str, label: str, options: Sequence[tuple[str, object]]) -> Choice:
        value = getattr(self._settings.preferences, field)
        return Choice(label, options, value, lambda new: self._set(field, new))

    def _set(self, field: str, value: object) -> None:
        self._settings.prefer(**{field: value})
        self.form.message = self._changed(field) or _AT_ONCE


class KeysMenu:
    """Key bindings. Assigning a key to a command takes it from all others.

    Args:
        changed: Function that receives the new keys.
    """

    def __init__(self, keys: KeyMap, changed: Callable[[KeyMap], None] = lambda keys: None) -> None:
        self.keys = keys
        self._changed = changed
        self._fields = {
            command: KeyField(_WORDS[command], "", self._changer(command))
            for command in DEFAULT_KEYS
        }
        reset = _ActionRow("Reset to defaults", lambda: self._take(KeyMap()))
        rows: list[Row] = [*self._fields.values(), reset, Button("Back", "back")]
        self.form = Form("Keys", rows, layout=FormLayout(pinned=1))
        self.form.message = _FIXED
        self._show()

    def _changer(self, command: Command) -> Callable[[str], None]:
        return lambda key: self._take(self.keys.with_key(command, key))

    def _take(self, keys: KeyMap) -> None:
        # The key may have been the only one of another command. The player has to know that.
        lost = [
            _WORDS[command]
            for command in DEFAULT_KEYS
            if self.keys.keys(command) and not keys.keys(command)
        ]
        self.keys = keys
        self._show()
        self.form.message = f"No key left for: {', '.join(lost)}." if lost else _FIXED
        self._changed(keys)

    def _show(self) -> None:
        for command, field in self._fields.items():
            keys = self.keys.keys(command)
            field.current = keys[0] if keys else ""


class _ActionRow(Row):
    """Button that runs a function and leaves the form open."""

    def __init__(self, label: str, run: Callable[[], None]) -> None:
        super().__init__(label)
        self._run = run

    def command(self, command: Command) -> bool:
        if command in (Command.USE, Command.ENTER):
            self._run()
        return False
