"""Forms without the application: drawn once, or shown while a test posts events."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import cache

import pygame

from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Display, Screen, text_size
from robotouille_client.window.pictures.text_surfaces import Typesetter

__all__ = ["asked", "ctrl", "drawn", "typesetter"]


def ctrl(key: int) -> None:
    """Press a key with Ctrl."""
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=pygame.KMOD_LCTRL, unicode=""))


def asked(display: Display, form: Form, *frames: Callable[[], None]) -> object:
    """Show a form, call one function per frame, and return the form's result."""
    doing = iter(frames)

    async def sleep(seconds: float) -> None:
        next(doing, lambda: None)()
        await asyncio.sleep(0)

    async def main() -> object:
        until: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        ticks = iter([*[None] * (len(frames) + 60)])

        async def limited(seconds: float) -> None:
            await sleep(seconds)
            if next(ticks, 1) == 1 and not until.done():
                until.set_result(None)

        return await Screen(display, sleep=limited).ask(form, until)

    return asyncio.run(main())


def drawn(form: Form, size: tuple[int, int], scale: float = 1.0) -> pygame.Surface:
    """Draw a form into a window of this size."""
    surface = pygame.Surface(size)
    height = text_size(size, scale)
    area = surface.get_rect().inflate(-height, -height)
    form.draw(surface, area, typesetter(), height)
    return surface


@cache
def typesetter() -> Typesetter:
    """Return one typesetter for all forms, so that fonts load once."""
    return Typesetter()
