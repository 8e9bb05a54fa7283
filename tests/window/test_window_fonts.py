"""Text in any script: from the first font that has it, and never as boxes."""

from __future__ import annotations

import pygame
import pytest

from robotouille_client.window.pictures.fonts import FontStack, printable, system_fonts
from robotouille_client.window.pictures.text_surfaces import Typesetter

ONLY_DEFAULT = FontStack(find=tuple)
INK = (10, 20, 30)


def pixels(text: str, fonts: FontStack) -> bytes:
    return pygame.image.tobytes(Typesetter(fonts).line(text, 20, INK), "RGBA")


def test_what_the_default_font_has_needs_no_other() -> None:
    def never() -> list[str]:
        raise AssertionError("the system was asked for fonts")

    fonts = FontStack(find=never)
    assert fonts.runs("Ada, Björn & Zoë") == [(0, "Ada, Björn & Zoë")]
    assert fonts.runs("") == [(0, "")]


def test_a_letter_that_no_font_has_is_its_code() -> None:
    assert ONLY_DEFAULT.runs("a厨b") == [(0, "a[53A8]b")]
    assert pixels("厨", ONLY_DEFAULT) != pixels("房", ONLY_DEFAULT)
    assert pixels("厨", ONLY_DEFAULT) == pixels("[53A8]", ONLY_DEFAULT)


def test_joiners_and_selectors_are_left_out() -> None:
    assert printable("👩\u200d🍳\ufe0f") == "👩🍳"
    assert printable("a\0b\ud800c\td") == "a b c d"
    assert len(printable("x" * 9000)) == 600


def test_the_first_font_that_has_a_letter_is_taken() -> None:
    path = pygame.font.match_font("dejavusans")
    if path is None:
        pytest.skip("DejaVu Sans is not installed")
    opened = []

    def find():
        for each in ("/nowhere/missing.ttf", path):
            opened.append(each)
            yield each

    fonts = FontStack(find)
    assert fonts.runs("Ada ⚀ Bob") == [(0, "Ada "), (1, "⚀"), (0, " Bob")]
    assert fonts.runs("⚁")[0][0] == 1
    assert opened == ["/nowhere/missing.ttf", path], "looked for once"
    text = Typesetter(fonts)
    assert text.width("Ada ⚀ Bob", 20) > text.width("Ada  Bob", 20)
    assert pixels("⚀", fonts) != pixels("⚁", fonts) != pixels("[2681]", fonts)


def test_all_fonts_of_the_system_are_found_once() -> None:
    found = list(system_fonts())
    assert len(found) == len(set(found))


@pytest.mark.parametrize(
    "name", ["厨房の田中さん", "Мария", "مريم", "नेहा", "👩\u200d🍳 Chef", "W" * 40]
)
def test_any_name_fits_its_room(name: str) -> None:
    text = Typesetter()
    fitted = text.fit(name, 16, 120)
    assert 0 < text.width(fitted, 16) <= 120
    surface = text.line(fitted, 16, INK)
    assert surface.get_width() <= 121
    assert any(surface.get_at((x, y)).a for x in range(surface.get_width())
               for y in range(surface.get_height()))  # fmt: skip
