"""Gradients of SVG pictures as SDL_image understands them.

Coordinates of a gradient are shares of the shape's box, unless it says `userSpaceOnUse`: `1` and
`100%` are the same (W3C, Scalable Vector Graphics 1.1, section 13.2). NanoSVG, with which SDL_image
draws, takes a plain number for one of pixels, and so shows the last colour alone; percentages it
understands.
"""

from __future__ import annotations

import re

__all__ = ["with_percentages"]

_GRADIENT = re.compile(rb"<(?:\w+:)?(?:linear|radial)Gradient\b[^<>]*>")
_SHARE = re.compile(
    rb"""(\s(?:[xy][12]|[cf][xy]|r)\s*=\s*["']\s*)([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?=\s*["'])"""
)


def with_percentages(svg: bytes) -> bytes:
    """The same picture, with shares of a box as percentages."""
    return _GRADIENT.sub(_rewritten, svg)


def _rewritten(gradient: re.Match[bytes]) -> bytes:
    tag = gradient[0]
    return tag if b"userSpaceOnUse" in tag else _SHARE.sub(_percentage, tag)


def _percentage(share: re.Match[bytes]) -> bytes:
    return share[1] + f"{100 * float(share[2]):.6g}%".encode()
