"""Vector pictures from elsewhere: what of an SVG file is kept, and all else is left out.

W3C, Scalable Vector Graphics 1.1, https://www.w3.org/TR/SVG11/; what windows draw of it is shapes,
paths, gradients and transformations.
"""

from __future__ import annotations

from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from robotouille.domain.pictures.png import MAX_PICTURE_BYTES, PictureError
from robotouille.domain.pictures.strokes import Strokes

__all__ = ["MAX_OUTLINES", "MAX_SHAPES", "plain_svg"]

MAX_SHAPES = 2_000
"""Elements: what is drawn from a file takes as long as there are."""
MAX_OUTLINES = 32 * 1024
"""Letters of all paths and points together: with more of them a picture takes seconds to draw."""
MAX_DEPTH = 32
NAMESPACE = "http://www.w3.org/2000/svg"
BETWEEN = " "
"""Between a namespace and a name, where expat puts them together; no name has it."""

SHAPES = frozenset({
    "svg", "g", "defs", "path", "rect", "circle", "ellipse", "line", "polyline", "polygon",
    "linearGradient", "radialGradient", "stop",
})  # fmt: skip
ATTRIBUTES = frozenset({
    "viewBox", "preserveAspectRatio", "width", "height", "x", "y", "x1", "y1", "x2", "y2", "cx",
    "cy", "r", "rx", "ry", "fx", "fy", "d", "points", "transform", "id", "offset", "opacity",
    "fill", "fill-opacity", "fill-rule", "stroke", "stroke-width", "stroke-opacity",
    "stroke-linejoin", "stroke-linecap", "stroke-miterlimit", "stop-color", "stop-opacity",
    "gradientUnits", "gradientTransform", "spreadMethod", "style", "display",
})  # fmt: skip
"""No dashes: a long line of tiny ones is never drawn to its end."""
OUTLINES = ("d", "points")
STYLES = ATTRIBUTES - {*OUTLINES, "transform"}
"""What is measured is measured as an attribute."""


def plain_svg(content: bytes) -> bytes:
    """A picture with its shapes and how these are painted, and nothing else.

    Raises:
        PictureError: It is no SVG, is too long, declares a document type (which may define
            entities), is nested too deep, has no size, too many shapes, too long outlines or
            too wide strokes.
    """
    if len(content) > MAX_PICTURE_BYTES:
        raise PictureError(f"has {len(content):,} bytes; at most {MAX_PICTURE_BYTES:,} are taken")
    reading = _Reading()
    try:
        reading.parser.Parse(content, True)
    except expat.ExpatError as error:
        raise PictureError(f"is no SVG picture: {error}") from None
    if not reading.written:
        raise PictureError("is no SVG picture: its first element is not svg")
    return "".join(reading.written).encode()


class _Reading:
    """Writes what is kept of a document as it is read."""

    def __init__(self) -> None:
        self.written: list[str] = []
        self.parser = expat.ParserCreate("UTF-8", BETWEEN)
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype
        self._depth = self._shapes = self._outlines = 0
        self._strokes = Strokes()
        self._left_out = 0
        """How deep one is in an element that is left out."""

    def _doctype(self, *_: object) -> None:
        raise PictureError("declares a document type, which pictures must not")

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._shapes += 1
        if self._depth > MAX_DEPTH:
            raise PictureError(f"is nested deeper than {MAX_DEPTH} elements")
        if self._shapes > MAX_SHAPES:
            raise PictureError(f"has more than {MAX_SHAPES:,} elements")
        self._outlines += sum(len(attributes.get(key, "")) for key in OUTLINES)
        if self._outlines > MAX_OUTLINES:
            raise PictureError(f"has outlines of more than {MAX_OUTLINES:,} letters")
        namespace, _, shape = name.rpartition(BETWEEN)
        kept = namespace in ("", NAMESPACE) and shape in SHAPES and (shape == "svg") == self._first
        if self._left_out or not kept:
            self._left_out += 1
            return
        self._strokes.begin(attributes)
        space = f' xmlns="{NAMESPACE}"' if self._first else ""
        pairs = (
            f" {key}={quoteattr(_plain_style(value) if key == 'style' else value)}"
            for key, value in attributes.items()
            if key in ATTRIBUTES and _is_local(value)
        )
        self.written.append(f"<{shape}{space}{''.join(pairs)}>")

    @property
    def _first(self) -> bool:
        return self._depth == 1

    def _end(self, name: str) -> None:
        self._depth -= 1
        if self._left_out:
            self._left_out -= 1
        else:
            self._strokes.end()
            self.written.append(f"</{name.rpartition(BETWEEN)[2]}>")


def _plain_style(value: str) -> str:
    """The declarations of a `style` that are attributes, too, and may be in one."""
    kept = (each for each in value.split(";") if each.partition(":")[0].strip() in STYLES)
    return ";".join(kept)


def _is_local(value: str) -> bool:
    """Whether an attribute refers to nothing outside the picture."""
    return "url(" not in value.casefold().replace("url(#", "")
