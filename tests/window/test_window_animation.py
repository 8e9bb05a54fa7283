"""Animation during a step: walks, hands, travelling objects, stations in use, particles."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace
from itertools import pairwise

import pygame
import pytest
from tests.support.scripted import planned

from robotouille import State, Timing, World, load_task
from robotouille.domain.art import Art, ParticleEffect
from robotouille.domain.rendering import RenderingFile, rendering_of
from robotouille.world.scene import scene
from robotouille_client.window.drawing.kitchen.animation import (
    Moment,
    StepAnimation,
    step_animation,
)
from robotouille_client.window.drawing.kitchen.spots import Motion, Pose
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import View

SIZE = (640, 400)


@pytest.fixture(scope="module")
def course() -> list[State]:
    return planned("asynchronous/04", 1)


def lived(course: list[State], step: int, *, settled: bool = False) -> StepAnimation:
    painter = Painter()
    before, now = (Moment(s, painter.stage(s)) for s in course[step - 1 : step + 1])
    return step_animation(rendering_of(now.state.world.task), now, before, settled=settled)


def pictures(course: list[State], step: int, painter: Painter) -> set[bytes]:
    shown = View(course[step].world, course[step], course[step - 1], step)
    found = set()
    for phase in (0.2, 0.45, 0.7):
        surface = pygame.Surface(SIZE)
        painter.paint(surface, replace(shown, phase=phase))
        found.add(pygame.image.tobytes(surface, "RGB"))
    return found


@pytest.mark.parametrize(("step", "thing"), [(2, "bottombun1"), (8, "patty1"), (19, "tomato1")])
def test_moved_objects_travel(course, step: int, thing: str) -> None:
    assert lived(course, step).travels == {thing}
    assert len(pictures(course, step, Painter())) == 3
    assert not lived(course, 10).travels, "held objects move with their player"


def test_players_with_repeated_work_move_their_arms(course) -> None:
    assert [bool(lived(course, step).working) for step in (13, 14, 15, 16, 17)] == [
        False, True, True, True, False,
    ]  # fmt: skip
    assert lived(course, 15).working == {"robot1"}


def effects(course: list[State], step: int) -> list[tuple[str, str]]:
    return [(e.effect.asset, e.source) for e in lived(course, step).emissions]


def test_particles_come_from_the_object(course) -> None:
    assert effects(course, 8) == []
    assert effects(course, 10) == [("effect_sizzle.svg", "patty1")]
    assert effects(course, 15) == [("effect_crumb.svg", "tomato1")]
    assert effects(course, len(course) - 1) == [("effect_star.svg", "robot1")]
    assert lived(course, len(course) - 1, settled=True).emissions == (), "the cheer is over"


@pytest.mark.parametrize(("station", "begins"), [("stove1", 9), ("fryer1", 34)])
def test_a_station_is_on_while_in_use(course, station: str, begins: int) -> None:
    painter = Painter()
    looks = [painter.stage(state).stations[station].asset for state in course]
    off, on = f"{station[:-1]}.svg", f"{station[:-1]}_on.svg"
    assert set(looks[:begins]) == {off}
    assert looks[begins] == on
    assert looks[-1] == off


def test_hot_soup_steams() -> None:
    for state in planned("multi_agent/07", 4)[1:]:
        stage = Painter().stage(state)
        pot = next(p for pile in stage.piles.values() for p in pile if p.name == "pot1")
        hot = pot.appearance.asset in ("pot_boiling.svg", "pot_soup.svg")
        assert pot.appearance.effects == (("steam",) if hot else ())


def test_reduced_motion_keeps_only_walks_and_travels(course) -> None:
    still = Painter(preferences=Preferences(reduced_motion=True))
    for step, count in ((15, 1), (2, 3)):
        shown = View(course[step].world, course[step], course[step - 1], step)
        frozen = replace(shown, previous=None)
        assert len(pictures(course, step, still)) >= count
        assert still.redraw_key(frozen) == still.redraw_key(replace(frozen, phase=0.3))
    lively = Painter()
    hot = View(course[10].world, course[10], course[10], 11, phase=0.55, step_seconds=0.2)
    later, last = replace(hot, phase=0.95), replace(hot, phase=1.0)
    assert lively.redraw_key(hot) == lively.redraw_key(replace(hot, phase=0.98)), (
        "ten pictures a second for sparks alone"
    )
    assert lively.redraw_key(later) != lively.redraw_key(last)
    assert still.redraw_key(hot) == still.redraw_key(last)


def lasting(effects) -> set[str]:
    """Return the types of special effects, at any depth."""
    return {e.type for e in effects} | {t for e in effects for t in lasting(e.sfx)}


@pytest.mark.parametrize("task", ["synchronous/01", "examples/pancakes", "workshop/02"])
def test_every_domain_shows_what_takes_time(task: str) -> None:
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


def test_a_pot_fills_and_heats_in_stages() -> None:
    looks: dict[str, int] = {}
    painter = Painter()
    for state in planned("multi_agent/07", 2)[1:]:
        for pile in painter.stage(state).piles.values():
            for piece in pile:
                looks.setdefault(piece.appearance.asset or "", len(looks))
    order = [
        "pot.svg", "pot_filling_1.svg", "pot_filling_2.svg", "pot_filling_3.svg", "pot_water.svg",
        "pot_soup_cold.svg", "pot_soup_heating.svg", "pot_soup.svg", "bowl_soup.svg",
    ]  # fmt: skip
    assert sorted(order, key=lambda asset: looks[asset]) == order


def test_stages_come_in_order() -> None:
    art = Art.model_validate({"asset": "a.svg", "during": ["fill"], "stages": ["b.svg", "c.svg"]})
    shares = (0.0, 0.3, 0.5, 0.6, 1.0)
    assert [art.at({"fill": share}) for share in shares] == ["b.svg"] * 3 + ["c.svg"] * 2
    assert [file for _, file in art.pictures("x")] == ["a.svg", "b.svg", "c.svg"]
    with pytest.raises(ValueError, match="'stages' need 'during'"):
        Art.model_validate({"asset": "a.svg", "stages": ["b.svg"]})


def test_an_unknown_effect_suggests_the_nearest() -> None:
    file = {"effects": {"steam": {"asset": "puff.svg"}}, "during": {"boil": "stem"}}
    with pytest.raises(ValueError, match=r"during.boil: there is no effect 'stem'.*'steam'"):
        RenderingFile.model_validate(file)
    assert ParticleEffect(asset="puff.svg").count == 3


def test_players_sweat_when_a_game_is_lost(course: list[State]) -> None:
    rendering, painter = rendering_of(course[0].world.task), Painter()
    now = Moment(course[3], painter.stage(course[3]))
    lost = step_animation(rendering, now, None, lost=True).emissions
    others = step_animation(rendering, now, None).emissions
    (sweat,) = (emission for emission in lost if emission not in others)
    assert (sweat.effect, sweat.source) == (rendering.effects["sweat"], "robot1")


def poses(motion: Motion, course: list[State], step: int, phase: float) -> Pose:
    before = scene(course[step - 1]) if step else None
    return motion.poses(course[step], scene(course[step]), before, step, phase)["robot1"]


def on_path(point: tuple[float, float], path: list[tuple[int, int]]) -> bool:
    """Return whether a point is on a straight leg between neighbouring tiles."""
    return any(
        math.dist(a, point) + math.dist(point, b) == pytest.approx(1) for a, b in pairwise(path)
    )


def test_a_short_walk_follows_the_path(play) -> None:
    world = World("asynchronous/09")
    course = play(world, "move table2")
    path = world.floor.path((5, 1), scene(course[1])["robot1"].tile)
    motion = Motion(world.floor)
    seen = [poses(motion, course, 1, i / 20) for i in range(21)]
    assert len(path) > 4
    assert seen[0].at == path[0]
    assert seen[-1] == Pose(path[-1], "front")
    assert all(on_path(pose.at, path) for pose in seen)
    assert all(pose.walking for pose in seen[:-1])


def test_a_long_walk_lasts_until_the_player_is_free(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    course = play(world, "move table2", *"-" * 12)
    steps = 1 + course[1].busy_steps("robot1")
    path = world.floor.path((5, 1), scene(course[1])["robot1"].tile)
    assert steps == len(path) - 1
    motion = Motion(world.floor)
    seen = [poses(motion, course, step, phase) for step in range(1, 13) for phase in (0, 0.5)]
    assert all(on_path(pose.at, path) for pose in seen)
    for tile, step in zip(path, range(1, steps + 2), strict=True):
        assert seen[2 * (step - 1)].at == pytest.approx(tile)
    assert not seen[2 * steps].walking


def test_skipping_steps_ends_a_walk(play) -> None:
    world = World(load_task("asynchronous/09", timing=Timing.PEOPLE))
    course = play(world, "move table2", *"-" * 4)
    motion = Motion(world.floor)
    poses(motion, course, 1, 0.5)
    assert poses(motion, course, 4, 0.5).at == scene(course[4])["robot1"].tile


def test_players_on_one_tile_are_drawn_side_by_side() -> None:
    world = World("multi_agent/09")
    now = scene(world.initial)
    first, second = world.players[:2]
    now[second] = dataclasses.replace(now[second], tile=now[first].tile)
    found = Motion(world.floor).poses(world.initial, now, None, 0, 1.0)
    assert found[first].at[1] == found[second].at[1]
    assert found[second].at[0] - found[first].at[0] == pytest.approx(0.5)
