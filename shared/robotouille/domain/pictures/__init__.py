"""Pictures from elsewhere, PNG or SVG: by which digest they are known, and what of them is kept."""

from __future__ import annotations

import hashlib

from robotouille.domain.pictures.png import MAX_PICTURE_BYTES, MAX_SIDE, PictureError, plain_png
from robotouille.domain.pictures.svg import plain_svg

__all__ = ["MAX_PICTURE_BYTES", "MAX_SIDE", "PictureError", "picture_digest", "plain_picture"]


def picture_digest(content: bytes) -> str:
    """SHA-256 in hexadecimal: by it pictures are asked for, and known."""
    return hashlib.sha256(content).hexdigest()


def plain_picture(name: str, content: bytes) -> bytes:
    """A picture without all that is not needed to draw it; what it is, its file's name says.

    Raises:
        PictureError: It is not what its name says, or not one that is taken.
    """
    return plain_svg(content) if name.endswith(".svg") else plain_png(content)
