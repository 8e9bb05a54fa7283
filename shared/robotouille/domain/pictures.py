"""Pictures from untrusted sources, PNG or SVG: their digests, and the safe parts that are kept."""

from __future__ import annotations

import hashlib
import math
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from robotouille.errors import RobotouilleError
from robotouille.files.reading import open_regular
from robotouille.installation import data_folder

MAX_PICTURE_BYTES = 256 * 1024
MAX_SIDE = 1024
"""Pixels. A decoded picture then takes at most 4 MiB, whatever the file claims."""
MAX_LOCAL_BYTES, MAX_LOCAL_SIDE = 16 * 1024 * 1024, 4096
"""Bytes and pixels of a side of a picture in a local folder."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
KEPT = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
"""Chunks that make the picture. Other chunks hold texts and profiles, which may be compressed."""


class PictureError(RobotouilleError):
    """Invalid picture, or one that is not accepted."""


def plain_png(content: bytes) -> bytes:
    """Return a PNG picture without anything that drawing does not need.

    Raises:
        PictureError: The data are not a complete PNG, or the picture is too large.
    """
    if len(content) > MAX_PICTURE_BYTES:
        raise PictureError(f"has {len(content):,} bytes; at most {MAX_PICTURE_BYTES:,} are allowed")
    if not content.startswith(SIGNATURE):
        raise PictureError("is not a PNG picture")
    chunks = list(_chunks(content))
    kinds = [kind for kind, _ in chunks]
    if kinds[0] != b"IHDR" or kinds[-1] != b"IEND" or kinds.count(b"IHDR") != 1:
        raise PictureError("is an incomplete PNG")
    width, height = struct.unpack(">II", chunks[0][1][:8])
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise PictureError(
            f"is {width} × {height} pixels; at most {MAX_SIDE} × {MAX_SIDE} are allowed"
        )
    kept = (_chunk(kind, data) for kind, data in chunks if kind in KEPT)
    return SIGNATURE + b"".join(kept)


def read_picture(path: Path) -> bytes:
    """Return the content of a local picture, PNG or SVG.

    A PNG may be larger than pictures from elsewhere, but some bytes of it can announce gigabytes
    of pixels. An SVG that is not shipped is reduced to what `plain_svg` keeps, because a short one
    can use up the memory.

    Raises:
        OSError: The file cannot be read.
        PictureError: It is not a picture, or is not accepted.
    """
    with open_regular(path) as file:
        content = file.read(MAX_LOCAL_BYTES + 1)
    if len(content) > MAX_LOCAL_BYTES:
        raise PictureError(f"has more than {MAX_LOCAL_BYTES:,} bytes")
    if path.suffix == ".svg":
        return content if path.resolve().is_relative_to(_shipped()) else plain_svg(content)
    if not content.startswith(SIGNATURE + b"\0\0\0\rIHDR") or len(content) < 24:
        raise PictureError("is neither SVG nor PNG")
    width, height = struct.unpack(">II", content[16:24])
    if not (0 < width <= MAX_LOCAL_SIDE and 0 < height <= MAX_LOCAL_SIDE):
        most = f"at most {MAX_LOCAL_SIDE} × {MAX_LOCAL_SIDE} are drawn"
        raise PictureError(f"has {width} × {height} pixels; {most}")
    return content


@cache
def _shipped() -> Path:
    return data_folder("assets").resolve()


def picture_fault(path: Path) -> str:
    """Return why a local picture cannot be used, or an empty text."""
    try:
        read_picture(path)
    except OSError as error:
        return error.strerror or str(error)
    except PictureError as error:
        return f"it {error}"
    return ""


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the kind and data of each chunk up to the end."""
    at = len(SIGNATURE)
    while at + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, at)
        kind, data = content[at + 4 : at + 8], content[at + 8 : at + 8 + size]
        check = content[at + 8 + size : at + 12 + size]
        if check != struct.pack(">I", zlib.crc32(kind + data)) or (kind == b"IHDR" and size != 13):
            break
        yield kind, data
        if kind == b"IEND":
            return
        at += 12 + size
    raise PictureError("is a damaged PNG")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


MAX_WIDTH = 4.0
"""Widest stroke, as a multiple of the picture's side."""
UNIT = 100.0
"""Pixels in the largest CSS unit, at most; an inch has 96."""
TRANSFORM = re.compile(
    r"\s*+(?:(?:matrix|translate|scale|rotate|skewX|skewY)\s*+\([^()]*+\)[\s,]*+)*+"
)
"""Transformations that all windows read alike. The pattern is possessive: linear on any text."""
FUNCTION = re.compile(r"([a-zA-Z]++)\s*+\(([^()]*+)\)")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
STYLE_WIDTH = re.compile(r"stroke-width\s*:([^;]*)")


class Strokes:
    """Checks stroke widths as elements of a picture begin and end."""

    def __init__(self) -> None:
        self._side = 0.0
        self._widest = 1.0  # The default stroke width.
        self._scales = [1.0]
        self._largest = 1.0

    def begin(self, attributes: Mapping[str, str]) -> None:
        """Begin an element.

        Raises:
            PictureError: Strokes may be too wide, or the picture has no size.
        """
        if not self._side:
            self._side = _side(attributes)
        self._scales.append(self._scales[-1] * _scale(attributes.get("transform", "")))
        self._largest = max(self._largest, self._scales[-1])
        for text in (
            attributes.get("stroke-width", ""),
            *STYLE_WIDTH.findall(attributes.get("style", "")),
        ):
            self._widest = max(self._widest, _length(text))
        # The condition uses `not`, so that it also rejects NaN.
        if not self._widest * self._largest <= MAX_WIDTH * self._side:
            raise PictureError(f"may have strokes more than {MAX_WIDTH:g} times its own width")

    def end(self) -> None:
        """End the newest element."""
        self._scales.pop()


def _side(attributes: Mapping[str, str]) -> float:
    """Return the shorter side of a picture, in its own units."""
    numbers = _numbers(attributes.get("viewBox", ""))[2:4]
    if len(numbers) < 2:
        numbers = [
            float(found[0])
            for name in ("width", "height")
            if (found := NUMBER.match(attributes.get(name, "").strip()))
        ]
    if len(numbers) < 2 or not 0 < min(numbers) < math.inf:
        raise PictureError("has neither a viewBox nor a width and a height")
    return min(numbers)


def _scale(transform: str) -> float:
    """Return the greatest factor by which a transformation enlarges."""
    if not TRANSFORM.fullmatch(transform):
        raise PictureError(f"has an invalid transformation: {transform[:40]!r}")
    factor = 1.0
    for name, arguments in FUNCTION.findall(transform):
        numbers = [abs(number) for number in _numbers(arguments)]
        if name == "scale":
            factor *= max(1.0, *numbers[:2], 0.0)
        elif name == "matrix":
            # A 2 × 2 matrix stretches by at most twice its largest entry.
            factor *= max(1.0, 2 * max(numbers[:4], default=0.0))
        elif name.startswith("skew") and numbers:
            factor *= 1 + abs(math.tan(math.radians(numbers[0] % 360)))
    return factor


def _length(text: str) -> float:
    """Return the greatest width in pixels; 0 without one."""
    found = NUMBER.match(text.strip())
    if found is None:
        return 0.0
    bare = found.end() == len(text.strip())
    return abs(float(found[0])) * (1.0 if bare or text.strip().endswith("px") else UNIT)


def _numbers(text: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(text)]


MAX_SHAPES = 2_000
"""Most elements: the time to draw a picture grows with them."""
MAX_DRAWN = 50_000_000
"""Most elements times pixels that are drawn: up to a second if every element covers it all."""
ELEMENT = re.compile(rb"<[A-Za-z]")
MAX_OUTLINES = 32 * 1024
"""Most characters in all paths and points. Longer outlines take seconds to draw."""
MAX_DEPTH = 32
NAMESPACE = "http://www.w3.org/2000/svg"
BETWEEN = " "
"""Separator that expat puts between a namespace and a name. No name contains it."""

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
"""Attributes that are kept. No dashes: a long line of tiny dashes takes forever to draw."""
OUTLINES = ("d", "points")
STYLES = ATTRIBUTES - {*OUTLINES, "transform"}
"""Properties allowed in `style`. Measured properties must be attributes."""


def plain_svg(content: bytes) -> bytes:
    """Return an SVG picture with only its shapes and their paint.

    Raises:
        PictureError: The data are not SVG, or declare a document type, which may define entities;
            or the picture is too long, too deep, without a size, or has too many shapes, too long
            outlines or too wide strokes.
    """
    if len(content) > MAX_PICTURE_BYTES:
        raise PictureError(f"has {len(content):,} bytes; at most {MAX_PICTURE_BYTES:,} are allowed")
    reading = _Reading()
    try:
        reading.parser.Parse(content, True)
    except expat.ExpatError as error:
        raise PictureError(f"is not an SVG picture: {error}") from None
    if not reading.written:
        raise PictureError("is not an SVG picture: its first element is not svg")
    return "".join(reading.written).encode()


class _Reading:
    """Writes the kept parts of a document as it is parsed."""

    def __init__(self) -> None:
        self.written: list[str] = []
        self.parser = expat.ParserCreate("UTF-8", BETWEEN)
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype
        self._depth = self._shapes = self._outlines = 0
        self._strokes = Strokes()
        self._left_out = 0
        """Depth within an element that is left out."""

    def _doctype(self, *_: object) -> None:
        raise PictureError("declares a document type, which pictures may not do")

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        self._shapes += 1
        if self._depth > MAX_DEPTH:
            raise PictureError(f"is nested deeper than {MAX_DEPTH} elements")
        if self._shapes > MAX_SHAPES:
            raise PictureError(f"has more than {MAX_SHAPES:,} elements")
        self._outlines += sum(len(attributes.get(key, "")) for key in OUTLINES)
        if self._outlines > MAX_OUTLINES:
            raise PictureError(f"has outlines of more than {MAX_OUTLINES:,} characters")
        namespace, _, shape = name.rpartition(BETWEEN)
        # Unknown elements are dropped with all they hold: scripts, texts, links, filters.
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
    """Return the declarations of a `style` that are allowed as attributes too."""
    kept = (each for each in value.split(";") if each.partition(":")[0].strip() in STYLES)
    return ";".join(kept)


def _is_local(value: str) -> bool:
    """Return whether an attribute refers to nothing outside the picture."""
    return "url(" not in value.casefold().replace("url(#", "")


def sharp_side(svg: bytes) -> int:
    """Return the largest side in pixels at which an SVG picture is drawn; larger ones are scaled.

    Every element may cover the whole picture, so drawing takes elements times pixels.
    """
    return math.isqrt(MAX_DRAWN // max(1, len(ELEMENT.findall(svg))))


def picture_digest(content: bytes) -> str:
    """Return the SHA-256 digest in hexadecimal, by which pictures are requested."""
    return hashlib.sha256(content).hexdigest()


def plain_picture(name: str, content: bytes) -> bytes:
    """Return a picture without anything that drawing does not need, by its file's suffix.

    Raises:
        PictureError: The content does not match the suffix, or is not accepted.
    """
    return plain_svg(content) if name.endswith(".svg") else plain_png(content)
