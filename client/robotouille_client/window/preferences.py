"""What a window's owner prefers: what the settings' screen shows, as one value."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["Preferences"]

Name = Annotated[str, Field(min_length=1, max_length=40)]
Word = Annotated[str, Field(max_length=40)]
Side = Annotated[int, Field(ge=160, le=8192)]


class Preferences(BaseModel):
    """What the window, and all that is shown in it, does as its owner likes it.

    The file of settings has them, the command line lays some of its own over those of the file for
    one time, and the settings' screen gives way to others; they never change themselves.

    `size` is that of the window in pixels, `rendering` the name of the one that is chosen for the
    kitchens that may look like it, `language_file` a file with words of the owner's own.
    `text_scale` makes letters larger or smaller, `strong_contrast` lighter or darker; with
    `reduced_motion` only what matters moves. `keys` are those that differ from the defaults.
    `server` is asked for kitchens, unless another one is named.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    name: Name = "player"
    size: tuple[Side, Side] = (1280, 720)
    fullscreen: bool = False
    sound: bool = True
    reduced_motion: bool = False
    strong_contrast: bool = False
    rendering: Annotated[str, Field(max_length=64)] = ""
    language_file: Annotated[str, Field(max_length=400)] = ""
    text_scale: Annotated[float, Field(ge=0.8, le=1.6)] = 1.0
    keys: dict[Word, list[Word]] = Field(default={}, max_length=40)
    server: Annotated[str, Field(max_length=200)] = "ws://127.0.0.1:8765"
