"""Values that configure a window: its display, style, devices and time source."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille_client.window.preferences import Preferences

if TYPE_CHECKING:
    from robotouille_client.window.drawing.painter import Painter
    from robotouille_client.window.drawing.window_layout import Strip
    from robotouille_client.window.pictures.appearance import KitchenLook


@dataclass(frozen=True, slots=True)
class DisplayOptions:
    """Options of a window that opens its own display.

    Attributes:
        headless: True to draw without a screen.
        screenshots: Folder for screenshots; None for the current one.
    """

    size: tuple[int, int] = (1280, 720)
    caption: str = "Robotouille"
    fps: int = 60
    headless: bool = False
    screenshots: Path | None = None


@dataclass(frozen=True, slots=True)
class WindowStyle:
    """Look of a window, and what it draws besides the game.

    Attributes:
        look: Rendering of a kitchen that is not installed; replaces the preferred one.
        words: Words that replace those of the kitchen's language.
        strip: Area below the kitchen, such as a timeline. It handles events before the game.
        painter: Painter to use instead of the window's own. It must draw the strip itself.
    """

    preferences: Preferences = field(default_factory=Preferences)
    look: KitchenLook | None = None
    words: Language = NO_WORDS
    strip: Strip | None = None
    painter: Painter | None = None


@dataclass(frozen=True, slots=True)
class TimeSource:
    """Clock and sleep function, which tests replace."""

    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep
