"""Text in any script: each letter in the first font that has it, and never as boxes."""

from __future__ import annotations

import unicodedata
from dataclasses import replace

import pygame
import pytest
from tests.support.samples import quick_sample

from robotouille import World
from robotouille_client.window.drawing.side_panel.panel import with_readable_names
from robotouille_client.window.pictures.fonts import FontStack, clusters, printable
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import SeatView, View

ONLY_DEFAULT = FontStack(find=tuple)
INK = (10, 20, 30)


def pixels(text: str, fonts: FontStack) -> bytes:
    return pygame.image.tobytes(Typesetter(fonts).line(text, 20, INK), "RGBA")


def test_the_default_font_comes_first() -> None:
    def never() -> list[str]:
        raise AssertionError("the system was asked for fonts")

    fonts = FontStack(find=never)
    assert fonts.runs("Ada, Björn & Zoë") == [(0, "Ada, Björn & Zoë")]
    assert fonts.runs("") == [(0, "")]


def test_unknown_letters_become_their_code() -> None:
    assert ONLY_DEFAULT.runs("a厨b") == [(0, "a[53A8]b")]
    assert pixels("厨", ONLY_DEFAULT) != pixels("房", ONLY_DEFAULT)
    assert pixels("厨", ONLY_DEFAULT) == pixels("[53A8]", ONLY_DEFAULT)


def test_unknown_letters_become_their_sound_or_meaning() -> None:
    assert ONLY_DEFAULT.runs("たなか 김 🍳") == [(0, "tanaka gim (cooking)")]
    assert ONLY_DEFAULT.runs("！🇩🇪👍🏽") == [(0, "!DE(thumbs up sign)")]
    assert ONLY_DEFAULT.runs("厨\u0301a") == [(0, "[53A8]a")], "no mark without its letter"


def test_letters_keep_their_marks_when_a_word_is_split() -> None:
    text = Typesetter(ONLY_DEFAULT)
    word = "ae\u0323\u0302" * 60
    for line in text.wrap(word, 16, 90):
        assert text.width(line, 16) <= 90
        assert not unicodedata.category(line[0]).startswith("M")
    assert clusters("e\u0301👍🏽🇩🇪x") == ["e\u0301", "👍🏽", "🇩🇪", "x"]
    assert printable("x" + "\u0323" * 50) == "x" + "\u0323" * 4


@pytest.mark.parametrize(
    "word", ["W" * 20 + "i" * 200, "i" * 200 + "W" * 20, "W" * 200, "厨房" * 90, "مريم" * 50]
)
@pytest.mark.parametrize("width", quick_sample([30, 1, 77, 200]))
def test_long_words_are_split_or_cut(word: str, width: int) -> None:
    text = Typesetter(ONLY_DEFAULT)
    widest = max(text.width(each, 14) for each in ("W", "[53A8]", "[645]"))
    for line in text.wrap(word, 14, width):
        assert text.width(line, 14) <= max(width, widest)
    cut = text.fit(word, 14, width)
    assert text.width(cut, 14) <= max(width, text.width("…", 14))
    assert cut.endswith("…")


def test_right_to_left_scripts() -> None:
    path = pygame.font.match_font("dejavusans")
    if path is None:
        pytest.skip("DejaVu Sans is not installed")
    fonts = FontStack(lambda: [path])
    assert fonts.runs("Ada שלום עולם!") == [(0, "Ada "), (1, "שלום עולם"), (0, "!")]
    mirrored = Typesetter(fonts).line("אאא ווו", 40, INK)
    left, right = (pygame.mask.from_surface(mirrored.subsurface(half)).count()
                   for half in ((0, 0, mirrored.get_width() // 2, mirrored.get_height()),
                                (mirrored.get_width() // 2, 0, mirrored.get_width() // 2,
                                 mirrored.get_height())))  # fmt: skip
    assert right > left, "the wide letters come first, on the right"


def test_unreadable_names_are_replaced_by_the_player() -> None:
    world = World("multi_agent/01@2")
    seats = (SeatView("robot1", "厨房の"), SeatView("robot2", "Ångström 厨"))
    view = View(world, world.initial, seats=seats, chat=(("厨房の", "Hello."), ("Ada", "Hi.")))
    received = with_readable_names(view, Typesetter(ONLY_DEFAULT))
    assert [seat.name for seat in received.seats] == ["robot1", "Ångström 厨"]
    assert received.chat == (("robot1", "Hello."), ("Ada", "Hi."))
    plain = replace(view, seats=(SeatView("robot1", "Ada"),))
    kana = replace(view, seats=(SeatView("robot1", "たなか"),))
    assert with_readable_names(kana, Typesetter(ONLY_DEFAULT)) is kana, "read as tanaka"
    assert with_readable_names(plain, Typesetter(ONLY_DEFAULT)) is plain


def test_joiners_and_selectors_are_dropped() -> None:
    assert printable("👩\u200d🍳\ufe0f") == "👩🍳"
    assert printable("a\0b\ud800c\td") == "a b c d"
    assert len(printable("x" * 9000)) == 600


def test_fonts_are_searched_in_order_and_once() -> None:
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
