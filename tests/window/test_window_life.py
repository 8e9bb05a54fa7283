"""What moves in a step: hands, what they take, what is in use, steam; or nothing, if asked."""

from __future__ import annotations

from dataclasses import replace

import pygame
import pytest

from robotouille import State, World, load_task
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.domain.rendering.art import Art, Effect
from robotouille.planning.plan import read_plan
from robotouille_client.window.drawing.kitchen.life import Life, Moment, life
from robotouille_client.window.drawing.kitchen.spots import Spot, ways
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import View

SIZE = (640, 400)
TASK, FILE = "asynchronous/04", "04_tomato_burger_and_fries.plan"


@pytest.fixture(scope="module")
def course() -> list[State]:
    world = World(load_task(TASK))
    states = [world.initial]
    for joint in read_plan((load_task(TASK).folder / FILE).read_text(), world):
        states.append(states[-1].step(list(joint)).state)
    return states


def lived(course: list[State], step: int) -> Life:
    painter = Painter()
    before, now = (Moment(s, painter.stage(s)) for s in course[step - 1 : step + 1])
    return life(rendering_of(now.state.world.task), now, before)


def pictures(course: list[State], step: int, painter: Painter) -> set[bytes]:
    shown = View(course[step].world, course[step], course[step - 1], step)
    found = set()
    for phase in (0.2, 0.45, 0.7):
        surface = pygame.Surface(SIZE)
        painter.paint(surface, replace(shown, phase=phase))
        found.add(pygame.image.tobytes(surface, "RGB"))
    return found


@pytest.mark.parametrize(("step", "thing"), [(2, "bottombun1"), (8, "patty1"), (19, "tomato1")])
def test_what_is_taken_put_or_stacked_travels(course, step: int, thing: str) -> None:
    assert lived(course, step).travels == {thing}
    assert len(pictures(course, step, Painter())) == 3
    assert not lived(course, 10).travels, "a walk takes what is held along"


def test_who_does_something_again_and_again_works(course) -> None:
    assert [bool(lived(course, step).working) for step in (13, 14, 15, 16, 17)] == [
        False, True, True, True, False,
    ]  # fmt: skip
    assert lived(course, 15).working == {"robot1"}


def effects(course: list[State], step: int) -> list[tuple[str, str]]:
    return [(e.effect.asset, e.source) for e in lived(course, step).emissions]


def test_effects_leave_what_something_is_done_to(course) -> None:
    assert effects(course, 8) == []
    assert effects(course, 10) == [("effect_sizzle.svg", "patty1")]
    assert effects(course, 15) == [("effect_crumb.svg", "tomato1")]
    assert effects(course, len(course) - 1) == [("effect_star.svg", "robot1")]


@pytest.mark.parametrize(("station", "begins"), [("stove1", 9), ("fryer1", 34)])
def test_a_station_is_on_only_while_it_is_in_use(course, station: str, begins: int) -> None:
    painter = Painter()
    looks = [painter.stage(state).stations[station].asset for state in course]
    off, on = f"{station[:-1]}.svg", f"{station[:-1]}_on.svg"
    assert set(looks[:begins]) == {off}
    assert looks[begins] == on
    assert looks[-1] == off


def test_hot_soup_steams(course) -> None:
    world = World(load_task("multi_agent/07", seats=4))
    text = (load_task("multi_agent/07").folder / "07_onion_potato_tomato_soup@4.plan").read_text()
    state = world.initial
    for joint in read_plan(text, world):
        state = state.step(list(joint)).state
        stage = Painter().stage(state)
        pot = next(p for pile in stage.piles.values() for p in pile if p.name == "pot1")
        hot = pot.appearance.asset in ("pot_boiling.svg", "pot_soup.svg")
        assert pot.appearance.effects == (("steam",) if hot else ())


def test_who_wants_no_movement_sees_only_that_from_place_to_place(course) -> None:
    still = Painter(preferences=Preferences(reduced_motion=True))
    for step, count in ((15, 1), (2, 3)):
        shown = View(course[step].world, course[step], course[step - 1], step)
        frozen = replace(shown, previous=None)
        assert len(pictures(course, step, still)) >= count
        assert still.seen(frozen).phase == 1.0
    lively = Painter()
    hot = View(course[10].world, course[10], course[10], 11, phase=0.55, step_seconds=0.2)
    assert lively.seen(hot).phase == 0.5, "ten pictures a second for sparks alone"
    assert still.seen(hot).phase == 1.0


def lasting(effects) -> set[str]:
    """The kinds of a domain's special effects, however deep they are."""
    return {e.type for e in effects} | {t for e in effects for t in lasting(e.sfx)}


@pytest.mark.parametrize("task", ["synchronous/01", "examples/pancakes", "workshop/02"])
def test_all_that_takes_time_is_seen_in_every_domain(task: str) -> None:
    domain, rendering = load_task(task).domain, rendering_of(load_task(task))
    shown = {action for _, _, art in rendering.arts() for action in art.during}
    for action in domain.action_defs:
        kinds = lasting(action.sfx)
        if kinds & {"delayed", "repetitive"}:
            assert action.name in rendering.during, "sparks, steam or crumbs"
            assert action.name in rendering.progress, "a sign in its ring"
        if "delayed" in kinds:
            assert action.name in shown, "a station that is on only in use"
    assert {"goal", "lost"} <= rendering.moments.keys()


def test_water_rises_while_a_pot_is_filled_and_gets_hot() -> None:
    looks: dict[str, int] = {}
    world = World(load_task("multi_agent/07", seats=2))
    text = (load_task("multi_agent/07").folder / "07_onion_potato_tomato_soup@2.plan").read_text()
    state, painter = world.initial, Painter()
    for joint in read_plan(text, world):
        state = state.step(list(joint)).state
        for pile in painter.stage(state).piles.values():
            for piece in pile:
                looks.setdefault(piece.appearance.asset or "", len(looks))
    order = [
        "pot.svg", "pot_filling_1.svg", "pot_filling_2.svg", "pot_filling_3.svg", "pot_water.svg",
        "pot_soup_cold.svg", "pot_soup_heating.svg", "pot_soup.svg", "bowl_soup.svg",
    ]  # fmt: skip
    assert sorted(order, key=lambda asset: looks[asset]) == order


def test_stages_are_shown_one_after_the_other() -> None:
    art = Art.model_validate({"asset": "a.svg", "during": ["fill"], "stages": ["b.svg", "c.svg"]})
    shares = (0.0, 0.3, 0.5, 0.6, 1.0)
    assert [art.at({"fill": share}) for share in shares] == ["b.svg"] * 3 + ["c.svg"] * 2
    assert [file for _, file in art.pictures("x")] == ["a.svg", "b.svg", "c.svg"]
    with pytest.raises(ValueError, match="'stages' need 'during'"):
        Art.model_validate({"asset": "a.svg", "stages": ["b.svg"]})


def test_what_is_in_a_pot_has_a_picture(course) -> None:
    world = World(load_task("multi_agent/07", seats=2))
    text = (load_task("multi_agent/07").folder / "07_onion_potato_tomato_soup@2.plan").read_text()
    state, painter = world.initial, Painter()
    for joint in list(read_plan(text, world))[:17]:
        state = state.step(list(joint)).state
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    listed = {words: look for look, words in resolver.listing(painter.stage(state), "stove1")}
    assert listed["boiling soup"].asset == "water_soup.svg"


def test_an_effect_that_is_not_there_is_named_with_the_nearest() -> None:
    file = {"effects": {"steam": {"asset": "puff.svg"}}, "during": {"boil": "stem"}}
    with pytest.raises(ValueError, match=r"during.boil: there is no effect 'stem'.*'steam'"):
        RenderingFile.model_validate(file)
    assert Effect(asset="puff.svg").count == 3


def test_players_sweat_where_a_game_is_lost(course: list[State]) -> None:
    rendering, painter = rendering_of(course[0].world.task), Painter()
    now = Moment(course[3], painter.stage(course[3]))
    lost = life(rendering, now, None, lost=True).emissions
    others = life(rendering, now, None).emissions
    (sweat,) = (emission for emission in lost if emission not in others)
    assert (sweat.effect, sweat.source) == (rendering.effects["sweat"], "robot1")


def test_words_keep_off_the_way_of_what_travels(course: list[State]) -> None:
    painter = Painter()
    step = next(i for i in range(1, len(course)) if lived(course, i).travels)
    now, before = painter.stage(course[step]), painter.stage(course[step - 1])
    (name,) = lived(course, step).travels
    here = {name: Spot(100, 100, 50.0)}
    earlier = {name: Spot(200, 60, 50.0)}
    (area,) = ways(now, here, earlier, {name})
    assert area.collidepoint(101, 99)
    assert area.collidepoint(199, 61)
    assert ways(now, here, {}, {name}) == []
    assert ways(before, here, earlier, set()) == []
