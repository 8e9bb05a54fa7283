"""Gradients of pictures, whichever way their coordinates are written."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille_client.window.pictures.sprites import Sprites, with_percentages
from robotouille_client.window.pictures.text_surfaces import Typesetter

SIDE = 32
PICTURE = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128"><defs>{}
<stop offset="0" stop-color="#ff0000"/><stop offset="1" stop-color="#0000ff"/></{}Gradient></defs>
<rect width="128" height="128" fill="url(#g)"/></svg>"""


@pytest.mark.parametrize(
    ("plain", "percent"),
    [
        ('<linearGradient id="g" x2="0" y2="1">', '<linearGradient id="g" x2="0%" y2="100%">'),
        (
            "<linearGradient id='g' x1='.25' y1='0' x2='1.0' y2='1e-1'>",
            "<linearGradient id='g' x1='25%' y1='0%' x2='100%' y2='10%'>",
        ),
        (
            '<radialGradient id="g" cx="0.5" cy="0.4" r="0.75">',
            '<radialGradient id="g" cx="50%" cy="40%" r="75%">',
        ),
    ],
)
def test_plain_numbers_are_drawn_like_percentages(tmp_path: Path, plain: str, percent: str) -> None:
    kind = "linear" if "linear" in plain else "radial"
    for name, tag in (("plain.svg", plain), ("percent.svg", percent)):
        (tmp_path / name).write_text(PICTURE.format(tag, kind))
    sprites = Sprites((tmp_path,), Typesetter())
    one, other = sprites.file("plain.svg", SIDE), sprites.file("percent.svg", SIDE)
    assert one is not None
    assert other is not None
    assert one.get_buffer().raw == other.get_buffer().raw
    assert len({tuple(one.get_at((x, x))) for x in range(SIDE)}) > 5


def test_what_is_in_pixels_or_in_percent_already_stays() -> None:
    for tag in (
        '<linearGradient id="g1" gradientUnits="userSpaceOnUse" x1="3" y1="0" x2="9" y2="1">',
        '<radialGradient id="g2" cx="50%" r="75%">',
        '<rect x="1" r="2"/>',
    ):
        assert (
            with_percentages(PICTURE.format(tag, "linear").encode())
            == PICTURE.format(tag, "linear").encode()
        )


@pytest.mark.parametrize("number", ["1", "1.", ".1", "1e1"])
def test_a_number_without_an_end_takes_no_time(number: str) -> None:
    """A server may send it; digit by digit it took hours, in which this test would not end."""
    long = number + number[-1] * 250_000
    tag = f'<linearGradient id="g" x1="{long}z">'
    assert with_percentages(tag.encode()) == tag.encode()
