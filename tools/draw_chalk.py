"""Convert pictures to coloured chalk on slate, for the rendering `chalk`.

    python tools/draw_chalk.py                 convert pictures missing from assets/chalk
    python tools/draw_chalk.py stove.svg …     convert these pictures and overwrite them

A filled area becomes slate with a tint of its colour. An outline becomes a chalk line of that
colour. Pictures drawn by hand (the floor, the wall, furniture) are overwritten only if they are
named.
"""

from __future__ import annotations

import argparse
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

ASSETS = Path(__file__).resolve().parents[1] / "assets"
FOLDERS = ("kitchen", "diner", "restaurant", "workshop")
"""Folders of pictures to convert. The first folder that has a name wins."""
SVG = "http://www.w3.org/2000/svg"
Rgb = tuple[int, int, int]
INK: Rgb = (0x3B, 0x2F, 0x2F)
SLATE: Rgb = (0x26, 0x33, 0x36)
CHALK: Rgb = (0xF1, 0xEE, 0xE2)
WIDE = 6
"""Minimum width of a line that is a shape of its own, such as an arm, and not an outline."""
SHAPES = {"path", "rect", "circle", "ellipse", "polygon", "line", "polyline"}


def mixed(one: Rgb, other: Rgb, share: float) -> Rgb:
    """Mix a share of another colour into a colour."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(one, other, strict=True))
    return red, green, blue


def lit(colour: Rgb) -> Rgb:
    """Return a pale version of a colour, like chalk, that is never dark."""
    pale = mixed(colour, CHALK, 0.3)
    luma = (3 * pale[0] + 6 * pale[1] + pale[2]) / 10
    return mixed(pale, CHALK, min(1.0, max(0.0, (150 - luma) / 150)))


def is_ink(colour: Rgb) -> bool:
    """Return whether a colour is dark enough to be an outline."""
    return max(colour) < 0x60


class Chalk:
    """One picture to convert."""

    def __init__(self, text: str) -> None:
        self._root = ET.fromstring(text)  # noqa: S314 (the project's own pictures)
        self._gradients = {
            f"url(#{g.get('id')})": self._mean(g) for g in self._root.iter() if g.get("id")
        }

    def drawn(self) -> str:
        """Return the picture as chalk, in SVG."""
        self._draw(self._root, {})
        for parent in self._root.iter():
            for defs in parent.findall(f"{{{SVG}}}defs"):
                parent.remove(defs)
        ET.register_namespace("", SVG)
        text = ET.tostring(self._root, encoding="unicode")
        return re.sub(r"\n\s*\n", "\n", text) + "\n"

    def _draw(self, element: ET.Element, inherited: dict[str, str]) -> None:
        own = {**inherited, **{k: v for k, v in element.attrib.items() if k.startswith("stroke")}}
        if element.tag.rpartition("}")[2] in SHAPES:
            self._shape(element, own)
        for child in element:
            self._draw(child, own)

    def _shape(self, shape: ET.Element, own: dict[str, str]) -> None:
        fill = self._colour(shape.get("fill", "#000000"))
        stroke = self._colour(own.get("stroke", "none"))
        width = float(own.get("stroke-width", "1"))
        if fill is not None:
            shape.set("fill", _hex(mixed(fill, SLATE, 0.5 if stroke else 0.35)))
        if stroke is None:
            return
        if fill is None and not is_ink(stroke) and width >= WIDE:
            shape.set("stroke", _hex(mixed(stroke, SLATE, 0.6)))
            return
        shape.set("stroke", _hex(lit(fill if fill is not None and is_ink(stroke) else stroke)))

    def _colour(self, words: str) -> Rgb | None:
        if words == "none":
            return None
        if words in self._gradients:
            return self._gradients[words]
        digits = words.removeprefix("#")
        return int(digits[:2], 16), int(digits[2:4], 16), int(digits[4:], 16)

    def _mean(self, gradient: ET.Element) -> Rgb:
        stops = [s.get("stop-color", "#000000").removeprefix("#") for s in gradient]
        sums = [sum(int(s[i : i + 2], 16) for s in stops) for i in (0, 2, 4)]
        red, green, blue = (total // max(1, len(stops)) for total in sums)
        return red, green, blue


def _hex(colour: Rgb) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def main(arguments: Sequence[str] | None = None) -> None:
    """Convert the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME.svg")
    named = parser.parse_args(arguments).names
    chalk = ASSETS / "chalk"
    chalk.mkdir(exist_ok=True)
    there = {path.name for path in chalk.glob("*.svg")}
    drawings = {
        path.name: path for folder in reversed(FOLDERS) for path in (ASSETS / folder).glob("*.svg")
    }
    for name in named or sorted(drawings.keys() - there):
        drawn = Chalk(drawings[name].read_text(encoding="utf-8")).drawn()
        (chalk / name).write_text(drawn, encoding="utf-8")
        print(f"chalk/{name}")


if __name__ == "__main__":
    main()
