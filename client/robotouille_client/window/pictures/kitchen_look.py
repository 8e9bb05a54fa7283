"""What a kitchen looks like that is not installed here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import InputFile

__all__ = ["KitchenLook"]


@dataclass(frozen=True, slots=True)
class KitchenLook:
    """A rendering, the keys of its actions, and the folder of its pictures."""

    rendering: RenderingFile
    bindings: InputFile
    pictures: Path
