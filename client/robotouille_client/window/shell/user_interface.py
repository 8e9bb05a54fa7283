"""What all screens and games of a process have in common: one display, its input, its settings."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

from robotouille.domain.rendering import NO_WORDS, read_language
from robotouille.errors import FileError, RobotouilleError
from robotouille.world.lint import lint_look
from robotouille_client.window.forms.cards import Cards
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import ClosedByOwnerError, Screen
from robotouille_client.window.hands.commands import KeyMap
from robotouille_client.window.hands.gamepad import Gamepads
from robotouille_client.window.hands.sounds import Sounds
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.shell.settings import Settings, SettingsFile
from robotouille_client.window.view import Source
from robotouille_client.window.window import Window

__all__ = ["UserInterface"]

T = TypeVar("T")


class UserInterface:
    """A display with its gamepads and sounds, on which forms are asked and games are shown.

    `message` is told by the next form that has room for it; `settings` are followed by what comes
    next. What changes in them is written to their `file` before anything else is shown: a process
    that is killed has forgotten nothing.

    Args:
        file: Where they are remembered, None to remember nothing.
        pictures: Where pictures that are saved go, None for the current folder.
        clock, sleep: Injected for tests.
    """

    def __init__(
        self,
        settings: Settings,
        display: Display,
        *,
        file: SettingsFile | None = None,
        pictures: Path | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.settings = settings
        self.display = display
        self.clock = clock
        self.message = ""
        self.file = file
        self._file_fault = ""
        self._pictures = pictures
        self._sleep = sleep
        self._gamepads = Gamepads()
        self.words = NO_WORDS
        self.words_fault = ""
        self._words_file = ""
        self.look_fault = ""
        self._look = ""
        self._sounds = None if display.headless else Sounds()
        self._screen = Screen(display, gamepads=self._gamepads, sleep=sleep)
        self.follow_settings()

    @property
    def preferences(self) -> Preferences:
        """What the window's owner prefers now."""
        return self.settings.preferences

    @property
    def keys(self) -> KeyMap:
        """The keys of the window's owner."""
        return self._screen.keys

    def open(self) -> None:
        """Open the display, and see which gamepads there are."""
        self.display.open()
        if not self.display.headless:
            self._gamepads.open()

    def close(self) -> None:
        """Close the display; there is no sound any more."""
        if self._sounds is not None:
            self._sounds.close()
        self.display.close()

    def follow_settings(self) -> None:
        """Do as the settings say."""
        preferences = self.preferences
        self._screen.prefer(preferences)
        if self._sounds is not None:
            self._sounds.on = preferences.sound
        if preferences.language_file != self._words_file:
            self._read_words(preferences.language_file)
        if preferences.rendering != self._look:
            self._check_look(preferences.rendering)

    def remember(self, *always: str) -> None:
        """Write what has changed in the settings, and those named `always` even where they were
        said for this time only; the next form says if that fails."""
        self.settings.prefer(size=self.display.size, fullscreen=self.display.fullscreen)
        if self.file is None:
            return
        fault = self.file.save(self.settings, *always)
        if fault != self._file_fault:
            self._file_fault, self.message = fault, fault or self.message

    def _check_look(self, look: str) -> None:
        """See that a look can be drawn; `look_fault` says what is missing in it. One that cannot
        be used at all is not taken."""
        self._look, self.look_fault = look, ""
        try:
            errors = lint_look(None, look)
        except RobotouilleError as error:
            self._look = ""
            self.settings.prefer(rendering="")
            first = error.faults[0] if isinstance(error, FileError) and error.faults else error
            self.look_fault = f"{look!r} cannot be used, kitchens look as usual: {first}"
            return
        faults = [fault for error in errors for fault in error.faults]
        if faults:
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            self.look_fault = f"{look!r} is not whole, tiles are drawn: {faults[0]}{more}"

    def _read_words(self, file: str) -> None:
        """Take the words of a file; of one that cannot be read none, and `words_fault` says why."""
        self._words_file, self.words, self.words_fault = file, NO_WORDS, ""
        try:
            if file:
                self.words = read_language(Path(file).expanduser())
        except (RobotouilleError, OSError, RuntimeError) as error:
            self.words_fault = f"No words of your own: {error}"

    def take_message(self) -> str:
        """The message, which is told once."""
        words, self.message = self.message, ""
        return words

    def splash(self, words: str) -> None:
        """Words in an otherwise empty window, while something is loaded."""
        self._screen.splash(words)

    async def ask(self, form: Form) -> object:
        """Show a form until it has a result; ClosedByOwnerError where the window is closed."""
        self.remember()
        return await self._screen.ask(form)

    async def wait(self, work: Awaitable[T], form: Form) -> T | None:
        """Something that takes a while, behind a form; None where its owner gave it up."""
        task = asyncio.ensure_future(work)
        self.remember()
        try:
            await self._screen.ask(form, until=task)
            return task.result() if task.done() else None
        finally:
            if not task.done():
                task.cancel()

    async def show(self, source: Source, cards: Cards, *, caption: str, **options: Any) -> object:
        """Show a game; what was chosen in it at last."""
        return await self.run_window(self.window(cards, caption=caption, **options), source)

    def window(self, cards: Cards, *, caption: str, **options: Any) -> Window:
        """A window in this display, with the settings of its owner."""
        self.display.caption = caption
        return Window(
            display=self.display,
            gamepads=self._gamepads,
            cards=cards,
            sounds=self._sounds,
            preferences=self.preferences,
            words=self.words,
            screenshots=self._pictures,
            clock=self.clock,
            sleep=self._sleep,
            **options,
        )

    async def run_window(self, window: Window, source: Source) -> object:
        """Run a window until something was chosen in it."""
        self.remember()
        await window.run(source, linger=None)
        if self._sounds is not None:
            self.settings.prefer(sound=self._sounds.on)
        if window.answer is None:
            raise ClosedByOwnerError
        return window.answer
