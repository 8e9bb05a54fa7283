"""Pictures from untrusted sources: which are accepted, and which parts are kept."""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.domain.pictures import (
    MAX_PICTURE_BYTES,
    MAX_SHAPES,
    MAX_SIDE,
    PictureError,
    plain_picture,
    plain_png,
    plain_svg,
)
from robotouille.installation import data_folder
from tests.support.pixels import chunk, png

SHIPPED = sorted(data_folder("assets").rglob("*.svg"))
OPEN = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"GIF89a", "is not a PNG"),
        (png((1, 2, 3))[:-4], "damaged"),
        (png((1, 2, 3)).replace(b"IDAT", b"IDAX"), "damaged"),
        (b"\x89PNG\r\n\x1a\n" + chunk(b"IEND", b""), "incomplete"),
        (png((1, 2, 3), side=MAX_SIDE + 1), "are allowed"),
        (b"\x89PNG\r\n\x1a\n" + bytes(MAX_PICTURE_BYTES), "at most"),
    ],
)
def test_invalid_png_pictures_are_refused(content: bytes, words: str) -> None:
    with pytest.raises(PictureError, match=words):
        plain_png(content)


def test_only_needed_png_chunks_are_kept() -> None:
    text = chunk(b"zTXt", b"secret\0\0" + zlib.compress(bytes(100_000)))
    assert plain_png(png((1, 2, 3), more=text)) == png((1, 2, 3))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not an SVG"),
        ('<svg viewBox="0 0 9 9">', "is not an SVG"),
        ("<html/>", "first element is not svg"),
        ("\x89PNG", "is not an SVG"),
        ('<!DOCTYPE svg [<!ENTITY a "aaaa">]><svg>&a;</svg>', "document type"),
        ('<!DOCTYPE svg SYSTEM "file:///etc/passwd"><svg/>', "document type"),
        (OPEN + "<g>" * 40 + "</g>" * 40 + "</svg>", "nested deeper"),
        (OPEN + "<g/>" * MAX_SHAPES + "</svg>", "more than 2,000 elements"),
        ("<svg/>", "neither a viewBox"),
        (OPEN + '<path stroke-width="1e6" d="M0 0L9 9"/></svg>', "strokes more than 4 times"),
        (OPEN + '<path style="fill:red;stroke-width:9in"/></svg>', "strokes more than 4 times"),
        (
            OPEN
            + '<g transform="scale(40)"><g transform="scale(.1) matrix(40 0 0 1 0 0)"/></g></svg>',
            "strokes more than 4 times",
        ),
        (OPEN + '<g transform="skewX(89.99999)"/></svg>', "strokes more than 4 times"),
        (OPEN + '<path stroke-width="1e999"/></svg>', "strokes more than 4 times"),
        (OPEN + '<g transform="xscale(900)"/></svg>', "invalid transformation"),
        (OPEN + '<g transform="scale now (900)"/></svg>', "invalid transformation"),
        (OPEN + f'<g transform="{"a" * 200_000}"/></svg>', "invalid transformation"),
        (OPEN + f'<g transform="{"scale(" * 30_000}"/></svg>', "invalid transformation"),
        (OPEN + f'<path d="{"L0 0" * 5000}"/><path d="{"L0 0" * 5000}"/></svg>', "outlines"),
        (OPEN + " " * MAX_PICTURE_BYTES + "</svg>", "at most"),
    ],
)
def test_invalid_svg_pictures_are_refused(text: str, words: str) -> None:
    with pytest.raises(PictureError, match=words):
        plain_svg(text.encode())


def test_only_shapes_and_paint_are_kept() -> None:
    text = """<?xml version="1.0"?><!-- me --><?go home?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
 xmlns:m="urn:m" viewBox="0 0 9 9" onload="go()" m:who="me">
<metadata><rect width="9" height="9"/></metadata><title>mine</title>
<script>go()</script><style>@import "http://a/b"</style>
<image xlink:href="http://a/b.png"/><use href="#a"/><m:rect width="9"/>
<svg><rect/></svg>
<defs><linearGradient id="a"><stop offset="0" stop-color="#fff"/></linearGradient></defs>
<g fill="url(#a)" stroke="url(http://a/b)"><path d="M0 0&lt;" onclick="go()"/></g></svg>"""
    kept = plain_picture("a.svg", text.encode()).decode()
    assert kept == (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">'
        '<defs><linearGradient id="a"><stop offset="0" stop-color="#fff"></stop></linearGradient>'
        '</defs><g fill="url(#a)"><path d="M0 0&lt;"></path></g></svg>'
    )
    assert plain_svg(kept.encode()).decode() == kept


def test_dashes_are_dropped() -> None:
    """The line would have ten thousand million dashes."""
    style = 'style="stroke: blue; stroke-dasharray : .0001;fill:none"'
    text = f'{OPEN}<path stroke-dasharray=".0001" {style} d="M0 0 L1e6 1e6"/></svg>'
    kept = plain_svg(text.encode()).decode()
    assert "dash" not in kept
    assert 'style="stroke: blue;fill:none"' in kept


def test_transformations_in_styles_are_dropped() -> None:
    kept = plain_svg(f'{OPEN}<path style="transform:scale(900);fill:red"/></svg>'.encode())
    assert b'style="fill:red"' in kept


@given(st.text(alphabet='<>/ ="svgrect&;:#()urlx\n', max_size=60))
def test_any_text_is_accepted_or_refused(text: str) -> None:
    try:
        kept = plain_svg(f"{OPEN}{text}</svg>".encode())
    except PictureError:
        return
    assert plain_svg(kept) == kept


@pytest.mark.slow
def test_shipped_pictures_look_the_same(tmp_path: Path) -> None:
    pygame = pytest.importorskip("pygame")
    copy = tmp_path / "copy.svg"
    assert SHIPPED
    for path in SHIPPED:
        copy.write_bytes(plain_svg(path.read_bytes()))
        drawn, again = (
            pygame.image.tobytes(pygame.image.load_sized_svg(os.fspath(one), (48, 48)), "RGBA")
            for one in (path, copy)
        )
        assert drawn == again, path
