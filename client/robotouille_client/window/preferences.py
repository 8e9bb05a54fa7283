"""Player's preferences, as shown in the settings."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(min_length=1, max_length=40)]
Word = Annotated[str, Field(max_length=40)]
Side = Annotated[int, Field(ge=160, le=8192)]
MAX_SERVER = 2000
"""Maximum length of the server's address. It may name several nodes."""
Share = Annotated[float, Field(ge=0, le=1)]


class Preferences(BaseModel):
    """Preferences of the player who uses the window. The value is immutable.

    The command line can override the settings file for one run.

    Attributes:
        size: Window size in pixels.
        rendering: Name of the rendering for kitchens that support it.
        language_file: File with the player's own words.
        volume: Volume of the sound effects, from 0 to 1.
        music: Volume of the music, from 0 to 1.
        reduced_motion: True if only the animations that carry information run.
        keys: Keys that differ from the defaults.
        server: Server to use unless another is given; several nodes are separated by commas.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    name: Name = "player"
    size: tuple[Side, Side] = (1280, 720)
    fullscreen: bool = False
    sound: bool = True
    volume: Share = 0.5
    music: Share = 0.2
    reduced_motion: bool = False
    strong_contrast: bool = False
    rendering: Annotated[str, Field(max_length=64)] = ""
    language_file: Annotated[str, Field(max_length=400)] = ""
    text_scale: Annotated[float, Field(ge=0.8, le=1.6)] = 1.0
    keys: dict[Word, list[Word]] = Field(default={}, max_length=40)
    server: Annotated[str, Field(max_length=MAX_SERVER)] = "ws://127.0.0.1:8765"
