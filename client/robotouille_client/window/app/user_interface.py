"""Display, input and settings that all screens and games of the app share."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from pathlib import Path
from typing import TypeVar

from robotouille.domain.rendering import NO_WORDS, read_language
from robotouille.errors import FileError, RobotouilleError
from robotouille.world.lint_renderings import lint_look
from robotouille_client.window.app.settings import Settings, SettingsFile
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import Strip
from robotouille_client.window.forms.card_slot import Cards
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Devices, Display, Screen, WindowClosedError
from robotouille_client.window.input.commands import Gamepads, KeyMap
from robotouille_client.window.input.sounds import Sounds
from robotouille_client.window.options import DisplayOptions, TimeSource, WindowStyle
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import GameSource
from robotouille_client.window.window import Window

T = TypeVar("T")


class UserInterface:
    """Display with gamepads and sounds, on which forms and games are shown.

    Changed settings are written before anything else is shown, so a killed process loses none.

    Attributes:
        message: Message for the next form.
        look_fault: What is wrong with the chosen look; empty if nothing is.
        words_fault: What is wrong with the player's own words; empty if nothing is.

    Args:
        file: Settings file; None to remember nothing.
        pictures: Folder for screenshots; None for the current one.
    """

    def __init__(
        self,
        settings: Settings,
        display: Display,
        *,
        file: SettingsFile | None = None,
        pictures: Path | None = None,
        time_source: TimeSource = TimeSource(),
    ) -> None:
        self.settings = settings
        self.display = display
        self.time_source = time_source
        self.message = ""
        self.file = file
        self._file_fault = ""
        self._pictures = pictures
        self._gamepads = Gamepads()
        self.words = NO_WORDS
        self.words_fault = ""
        self._words_file = ""
        self.look_fault = ""
        self._look = ""
        # Without a screen, nobody listens, so the sound card stays closed.
        self._sounds = None if display.headless else Sounds()
        self._screen = Screen(display, gamepads=self._gamepads, sleep=time_source.sleep)
        self.apply_settings()

    @property
    def preferences(self) -> Preferences:
        return self.settings.preferences

    @property
    def keys(self) -> KeyMap:
        return self._screen.keys

    def open(self) -> None:
        """Open the display, and look for gamepads."""
        self.display.open()
        if not self.display.headless:
            self._gamepads.open()

    def close(self) -> None:
        """Close the display, and release the sound card."""
        if self._sounds is not None:
            self._sounds.close()
        self.display.close()

    def apply_settings(self) -> None:
        """Apply the settings to what is shown next."""
        preferences = self.preferences
        self._screen.prefer(preferences)
        if self._sounds is not None:
            self._sounds.tune(preferences.volume, preferences.music, on=preferences.sound)
        if preferences.language_file != self._words_file:
            self._read_words(preferences.language_file)
        if preferences.rendering != self._look:
            self._check_look(preferences.rendering)

    def remember(self, *always: str) -> None:
        """Save changed settings; the next form reports a failure.

        The settings named `always` are saved even if the command line set them.
        """
        self.settings.prefer(size=self.display.size, fullscreen=self.display.fullscreen)
        if self.file is None:
            return
        # Saving happens before every form. One message for a full disk is enough.
        fault = self.file.save(self.settings, *always)
        if fault != self._file_fault:
            self._file_fault, self.message = fault, fault or self.message

    def _check_look(self, look: str) -> None:
        """Check that a look can be drawn, and go back to the default if not."""
        self._look, self.look_fault = look, ""
        try:
            errors = lint_look(None, look)
        except RobotouilleError as error:
            self._look = ""
            self.settings.prefer(rendering="")
            first = error.faults[0] if isinstance(error, FileError) and error.faults else error
            self.look_fault = f"Could not load the look {look!r}. Using the default look. {first}"
            return
        faults = [fault for error in errors for fault in error.faults]
        if faults:
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            self.look_fault = f"The look {look!r} lacks pictures: {faults[0]}{more}"

    def _read_words(self, file: str) -> None:
        self._words_file, self.words, self.words_fault = file, NO_WORDS, ""
        try:
            if file:
                self.words = read_language(Path(file).expanduser())
        except (RobotouilleError, OSError, RuntimeError) as error:
            self.words_fault = f"Could not load your words: {error}"

    def take_message(self) -> str:
        words, self.message = self.message, ""
        return words

    def splash(self, words: str) -> None:
        """Show a few words in an otherwise empty window while something loads."""
        self._screen.splash(words)

    async def ask(self, form: Form) -> object:
        """Show a form until it has a result.

        Raises:
            WindowClosedError: The player closed the window.
        """
        self.remember()
        return await self._screen.ask(form)

    async def wait(self, work: Awaitable[T], form: Form) -> T | None:
        """Await something slow behind a form; return None if the player cancels."""
        task = asyncio.ensure_future(work)
        self.remember()
        try:
            await self._screen.ask(form, until=task)
            return task.result() if task.done() else None
        finally:
            # This also runs when the player closes the window. The request must not outlive it.
            if not task.done():
                task.cancel()

    async def show(
        self,
        source: GameSource,
        cards: Cards,
        *,
        caption: str,
        look: KitchenLook | None = None,
        strip: Strip | None = None,
    ) -> object:
        """Show a game and return the player's choice at its end."""
        window = self.window(cards, caption=caption, look=look, strip=strip)
        return await self.run_window(window, source)

    def window(
        self,
        cards: Cards,
        *,
        caption: str,
        look: KitchenLook | None = None,
        strip: Strip | None = None,
        painter: Painter | None = None,
    ) -> Window:
        """Return a window in this display with the player's settings."""
        self.display.caption = caption
        return Window(
            DisplayOptions(screenshots=self._pictures),
            style=WindowStyle(self.preferences, look, self.words, strip, painter),
            cards=cards,
            devices=Devices(self.display, self._gamepads, self._sounds),
            time_source=self.time_source,
        )

    async def run_window(self, window: Window, source: GameSource) -> object:
        """Run a window until the player has made a choice in it.

        Raises:
            WindowClosedError: The player closed the window.
        """
        self.remember()
        await window.run(source, linger=None)
        # The key for sound works during a game, too.
        if self._sounds is not None:
            self.settings.prefer(sound=self._sounds.on)
        if window.answer is None:
            raise WindowClosedError
        return window.answer
