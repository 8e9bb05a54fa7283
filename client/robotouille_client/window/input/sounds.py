"""Sound effects of a game."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pygame

from robotouille.installation import data_folder
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.view import View

MUSIC = "music"
"""Name of the music among the sounds."""


class Sounds:
    """Player of sound effects and music; silent without a sound card. `on` turns both on or off."""

    def __init__(self, *, on: bool = True) -> None:
        self.on = on
        self._volume, self._music = 0.5, 0.0
        self._last: View | None = None
        self._loaded: dict[str, Any] = {}
        self._broken = False

    def tune(self, volume: float, music: float, *, on: bool) -> None:
        """Set the volumes of effects and music, from 0 to 1, and start or stop the music."""
        self._volume, self._music, self.on = volume, music, on
        playing = self._loaded.get(MUSIC)
        for sound in self._loaded.values():
            sound.set_volume(music if sound is playing else volume)
        if not (on and music):
            if playing is not None:
                playing.stop()
        elif playing is None or not playing.get_num_channels():
            self._play(MUSIC)

    def begin(self) -> None:
        """Start a new game: its first view plays no sounds."""
        self._last = None

    def follow(self, view: View) -> tuple[str, ...]:
        """Play the sounds of what happened since the last view, and return their names."""
        last, self._last = self._last, view
        names = sounds_between(last, view) if last is not None else ()
        if self.on:
            # More than two sounds at once are only noise.
            for name in names[:2]:
                self._play(name)
        return names

    def toggle(self) -> str:
        """Turn sound on or off; return a message for the player."""
        self.tune(self._volume, self._music, on=not self.on)
        return f"Sound {'on' if self.on else 'off'}"

    def _play(self, name: str) -> None:
        if self._broken:
            return
        try:
            if not pygame.mixer.get_init():
                # A buffer of 512 samples delays a sound by about 12 ms.
                with _silent_errors():
                    pygame.mixer.init(frequency=44100, buffer=512)
            sound = self._loaded.get(name)
            if sound is None:
                path = data_folder("assets") / "sounds" / f"{name}.wav"
                sound = self._loaded[name] = pygame.mixer.Sound(path)
                sound.set_volume(self._music if name == MUSIC else self._volume)
            sound.play(loops=-1 if name == MUSIC else 0)
        except (pygame.error, OSError, NotImplementedError):
            # After one failure, sounds stay off: further attempts could delay frames.
            self._broken = True

    def close(self) -> None:
        """Release the sound card."""
        with contextlib.suppress(pygame.error, NotImplementedError):
            pygame.mixer.quit()


@contextlib.contextmanager
def _silent_errors() -> Iterator[None]:
    """Discard what libraries write to the standard error.

    ALSA reports a missing sound card with a dozen lines that the player can do nothing about.
    """
    try:
        kept = os.dup(2)
    except OSError:  # The program has no standard error.
        yield
        return
    try:
        with Path(os.devnull).open("wb") as nothing:
            os.dup2(nothing.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def sounds_between(before: View, after: View) -> tuple[str, ...]:
    """Return the names of the sounds for the changes between two views."""
    names: list[str] = []
    if after.outcome and not before.outcome:
        names.append("won" if after.won else "lost")
    if after.me is not None and after.state is not before.state:
        names += _own(before.state, after.state, after.me)
    # The same rejection may be repeated in equal words, so bubbles are compared by identity.
    refused = {id(b) for b in before.bubbles}
    if any(b.kind == "rejected" and b.player == after.me and id(b) not in refused
           for b in after.bubbles):  # fmt: skip
        names.append("refused")
    if len(after.chat) and after.chat[-1:] != before.chat[-1:]:
        names.append("said")
    return tuple(names)


def _own(before: State, after: State, me: str) -> list[str]:
    """Return the sounds for the local player's actions and finished work."""
    if before.world is not after.world:
        return []
    then, now = scene(before), scene(after)
    names = []
    if then[me].at != now[me].at:
        names.append("walk")
    held = [sum(p.host == me for p in placed.values()) for placed in (then, now)]
    if held[0] != held[1]:
        names.append("take" if held[1] > held[0] else "put")
    at_work = {(row.action, row.arguments): row.done for row in before.progress()}
    still = {(row.action, row.arguments): row.done for row in after.progress()}
    if set(at_work) - set(still):
        names.append("ready")
    elif set(still) - set(at_work):
        names.append("work")
    return names
