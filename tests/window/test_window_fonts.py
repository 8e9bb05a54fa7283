"""Text in any script: from the first font that has it, and never as boxes."""

from __future__ import annotations

import unicodedata
from dataclasses import replace

import pygame
import pytest

from robotouille import World
from robotouille_client.window.drawing.panel.readable_names import with_readable_names
from robotouille_client.window.pictures.fonts import FontStack, clusters, printable, system_fonts
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import SeatView, View

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


def test_what_no_font_has_is_told_by_its_sound_or_meaning() -> None:
    assert ONLY_DEFAULT.runs("たなか 김 🍳") == [(0, "tanaka gim (cooking)")]
    assert ONLY_DEFAULT.runs("！🇩🇪👍🏽") == [(0, "!DE(thumbs up sign)")]
    assert ONLY_DEFAULT.runs("厨\u0301a") == [(0, "[53A8]a")], "no mark without its letter"


def test_letters_keep_their_marks_where_a_word_is_torn() -> None:
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
@pytest.mark.parametrize("width", [1, 30, 77, 200])
def test_a_word_that_does_not_fit_is_torn_or_cut(word: str, width: int) -> None:
    text = Typesetter(ONLY_DEFAULT)
    widest = max(text.width(each, 14) for each in ("W", "[53A8]", "[645]"))
    for line in text.wrap(word, 14, width):
        assert text.width(line, 14) <= max(width, widest)
    cut = text.fit(word, 14, width)
    assert text.width(cut, 14) <= max(width, text.width("…", 14))
    assert cut.endswith("…")


def test_words_are_written_from_the_right_where_their_script_is() -> None:
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


def test_who_has_a_name_that_no_font_has_is_called_what_the_player_is_called() -> None:
    world = World("multi_agent/01@2")
    seats = (SeatView("robot1", "厨房の"), SeatView("robot2", "Ångström 厨"))
    view = View(world, world.initial, seats=seats, chat=(("厨房の", "Hello."), ("Ada", "Hi.")))
    told = with_readable_names(view, Typesetter(ONLY_DEFAULT))
    assert [seat.name for seat in told.seats] == ["robot1", "Ångström 厨"]
    assert told.chat == (("robot1", "Hello."), ("Ada", "Hi."))
    plain = replace(view, seats=(SeatView("robot1", "Ada"),))
    kana = replace(view, seats=(SeatView("robot1", "たなか"),))
    assert with_readable_names(kana, Typesetter(ONLY_DEFAULT)) is kana, "read as tanaka"
    assert with_readable_names(plain, Typesetter(ONLY_DEFAULT)) is plain


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


def test_it_is_logged_once_that_letters_of_a_script_cannot_be_shaped(monkeypatch, caplog) -> None:
    def refused(font: pygame.font.Font, script: str) -> None:
        raise pygame.error("SDL_ttf was built without HarfBuzz")

    monkeypatch.setattr(
        "pygame.font.Font", type("Unshaped", (pygame.font.Font,), {"set_script": refused})
    )
    fonts = FontStack(find=tuple)
    for size in (12, 20):
        fonts.font(0, size, "Tibt")
    told = [record.getMessage() for record in caplog.records]
    assert told == ["letters of the script Tibt are not shaped: SDL_ttf was built without HarfBuzz"]
