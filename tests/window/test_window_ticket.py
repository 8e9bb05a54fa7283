"""The goal as pictures: from any domain's terms, ticked off as they come to hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pygame
import pytest
from tests.support.samples import first_quickly
from tests.support.scripted import after

from robotouille import State, World, load_task, task_names
from robotouille.certification.certificate import load_certificate
from robotouille.domain.rendering import NO_WORDS, Language, rendering_of
from robotouille.domain.schema import GoalTerm
from robotouille.planning.plan import read_plan
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.panel.dish_progress import (
    LayerProgress,
    fit,
    kept_in_place,
    progress,
    shares,
    stack_levels,
)
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.dishes import Dish, dishes
from robotouille_client.window.view import View

SIZE = (1280, 720)


def drawn(name: str) -> tuple[Dish, ...]:
    world = World(name)
    found = dishes(world, AppearanceResolver(world.task.domain, rendering_of(world.task)))
    assert found is not None
    return found


def pictures(dish: Dish) -> list[str]:
    return [layer.appearance.asset or layer.words for layer in dish.layers]


@pytest.mark.parametrize(
    ("task", "columns"),
    [
        (
            "multi_agent/06",
            [["bread.svg", "lettuce_cut.svg", "chicken_cooked.svg", "lettuce_cut.svg",
              "chicken_cooked.svg", "bread.svg", "table.svg"]],
        ),
        (
            "multi_agent/07",
            [["tomato_cut.svg", "potato.svg", "onion_cut.svg", "bowl_soup.svg", "table.svg"]],
        ),
        (
            "asynchronous/04",
            [["topbun.svg", "tomato_cut.svg", "patty_cooked.svg", "bottombun.svg", "table.svg"],
             ["potato_fried.svg", "table.svg"]],
        ),
        ("workshop/01", [["bolt.svg", "gear_painted_bolt.svg", "box_gear.svg"], ["bin_fed.svg"]]),
        ("examples/pancakes", [["pancake_syrup.svg", "pancake.svg", "table.svg"]]),
    ],
)  # fmt: skip
def test_dishes_are_read_from_the_top_down(task: str, columns: list[list[str]]) -> None:
    assert [pictures(dish) for dish in drawn(task)] == columns


@pytest.mark.parametrize("name", first_quickly(task_names(), 10))
def test_every_condition_is_on_the_ticket_once(name: str) -> None:
    numbers = [n for dish in drawn(name) for layer in dish.layers for n in layer.terms]
    assert sorted(numbers) == list(range(len(World(name).goal.terms)))


def test_layers_are_ticked_off_until_the_goal_is_reached() -> None:
    world = World(load_task("multi_agent/07", seats=4))
    text = (load_task("multi_agent/07").folder / "07_onion_potato_tomato_soup@4.plan").read_text()
    state, ticked = world.initial, []
    (dish,) = drawn("multi_agent/07")
    for joint in read_plan(text, world):
        state = state.step(list(joint)).state
        holding = world.goal.holding(state.facts)
        ticked.append(sum(all(holding[n] for n in layer.terms) for layer in dish.layers))
    assert state.goal_reached
    assert ticked[-1] == len(dish.layers)
    assert len(set(ticked)) >= 3


def settled(name: str) -> Iterator[dict[str, bool]]:
    """What is ticked before and after each step of a plan for two."""
    task = load_task(name, seats=2)
    world = World(task)
    plan = next(task.folder.glob(f"{task.name.rpartition('/')[2]}@2.plan"))
    state = world.initial
    yield {words: row.settled for words, row in far(state).items()}
    for joint in read_plan(plan.read_text(), world):
        state = state.step(list(joint)).state
        yield {words: row.settled for words, row in far(state).items()}


def test_nothing_is_ticked_at_the_start_and_everything_at_the_end() -> None:
    for name in ("multi_agent/01", "multi_agent/07", "multi_agent/06"):
        first, *_, last = settled(name)
        assert not any(first.values())
        assert all(last.values())


def test_a_layer_is_ticked_for_good() -> None:
    """No layer of a plan that is carried out loses its tick, whatever it lies on."""
    for name in ("multi_agent/01", "multi_agent/04", "multi_agent/07"):
        before: dict[str, bool] = {}
        for now in settled(name):
            assert all(now[words] for words, done in before.items() if done)
            before = now


def test_what_is_above_waits_for_what_is_below() -> None:
    (dish,) = drawn("multi_agent/01")
    top, lettuce, patty, bottom, table = dish.layers
    held = [True] * len(World("multi_agent/01").goal.terms)
    held[lettuce.terms[0]] = False
    first = [n in bottom.terms for n in range(len(held))]
    found = dict(zip(dish.layers, progress(dish, held, first), strict=True))
    assert not found[top].settled and found[top].share == 1
    assert found[patty].settled and found[bottom].settled
    assert found[lettuce].share == 0.5
    assert not found[table].settled
    assert all(far.settled for far in progress(dish, [True] * len(held), first))


def test_a_row_of_the_ticket_says_what_it_needs() -> None:
    world = World("multi_agent/01")
    painter, surface = Painter(), pygame.Surface(SIZE)
    painter.paint(surface, View(world, world.initial))
    x = painter.layout(SIZE, world).panel.left + 60
    told = {line for y in range(60, 300) for line in painter.told((x, y))}
    assert "Not yet: the lettuce has been cut." in told
    assert "Ready: the bottom bun lies directly on the table." in told
    assert world.task.goal_description in told


def test_a_goal_that_cannot_be_drawn_is_told_in_words() -> None:
    world = World("synchronous/01")
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    world.goal.terms = (GoalTerm(predicate="nothing", args=("robot",), ids=(1,)),)
    assert dishes(world, resolver) is None, "a goal about a player"
    world.goal.terms = ()
    assert dishes(world, resolver) is None


def shown(view: View, pointer: tuple[int, int] | None = None) -> bytes:
    surface = pygame.Surface(SIZE)
    Painter().paint(surface, view, UiOverlay(pointer=pointer))
    return pygame.image.tobytes(surface, "RGB")


def test_the_goal_in_words_is_told_where_the_mouse_is_on_the_ticket() -> None:
    world = World("multi_agent/07")
    view = View(world, world.initial)
    place = Painter().layout(SIZE, world)
    on_the_ticket = (place.panel.left + 60, 120)
    assert shown(view, on_the_ticket) != shown(view) == shown(view, (5, 5))


def test_seconds_are_left_where_a_clock_says_how_long_a_step_takes() -> None:
    world = World("multi_agent/07")
    view = View(world, world.initial, step=20, max_steps=80)
    timed = replace(view, step_seconds=0.2)
    assert shown(timed) != shown(view)
    assert shown(timed) != shown(replace(timed, step_seconds=0.5))


def test_hovering_lists_what_is_in_a_pot_or_stack() -> None:
    world = World(load_task("multi_agent/07", seats=4))
    text = (load_task("multi_agent/07").folder / "07_onion_potato_tomato_soup@4.plan").read_text()
    state = world.initial
    for joint in list(read_plan(text, world))[:15]:
        state = state.step(list(joint)).state
    painter = Painter()
    stage = painter.stage(state)
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    words = [words for _, words in resolver.listing(stage, "stove1")]
    assert words[0] == "pot"
    assert {"cut onion", "potato"} < set(words)


def test_the_ticket_calls_things_what_people_call_them() -> None:
    words = [layer.words for dish in drawn("multi_agent/01") for layer in dish.layers]
    assert "bottom bun" in words
    assert "bottombun" not in words


def test_the_ticket_is_in_the_words_of_the_windows_owner() -> None:
    world = World("multi_agent/01")
    words = Language.model_validate({"kinds": {"lettuce": "Salat"}})

    def ticket(*laid_over: Language) -> bytes:
        surface = pygame.Surface((1280, 720))
        painter = Painter(words=laid_over[0]) if laid_over else Painter()
        painter.paint(surface, View(world, world.initial))
        return pygame.image.tobytes(surface, "RGB")

    assert ticket(words) != ticket() == ticket(NO_WORDS)


def test_the_circle_fills_with_each_cut() -> None:
    """Work that has to be done several times is seen on the order before it is done."""
    world = World("training/01")
    state, seen = world.initial, []
    for line in load_certificate("training/01").plan or ():
        action = world.parse(state, world.players[0], line)
        state = state.step(action).state
        if action.name == "cut":
            seen.append(max(shares(state, world.goal.holding(state.facts))))
    assert seen[0] > 0.3
    assert seen[1] > 0.6
    assert seen[2] == 0.0, "it is done"


def far(state: State) -> dict[str, LayerProgress]:
    """How far each layer of a one-dish goal is, from the top down as the ticket draws it."""
    world = state.world
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    plain = dishes(world, resolver) or ()
    now, first = (fit(plain, each) for each in (state, world.initial))
    (dish,) = dishes(world, resolver, stack_levels(state, now)) or ()
    found = progress(dish, now.holding, first.holding, shares(state, now.holding))
    return {layer.words: row for layer, row in zip(dish.layers, found, strict=True)}


HOLDING_THE_BASE = ["pick-up-item bottombun1"]


def test_no_circle_fills_because_what_carries_all_is_in_hand() -> None:
    """Any table would do then: that on which the top bun happens to lie is no progress."""
    before = far(World("multi_agent/01").initial)
    held = far(after("multi_agent/01", *HOLDING_THE_BASE))
    assert all(row.share == 0 for row in before.values())
    assert all(row == LayerProgress(0, False) for name, row in held.items() if "bun" not in name)
    assert held["top bun"].share == 0


CUT = [
    "move table6", "pick-up-item lettuce1", "move board1", "place-item", "cut", "cut", "cut",
    "pick-up-item lettuce1", "move table2", "stack lettuce1 bottombun1",
]  # fmt: skip


def test_what_may_lie_in_any_order_is_drawn_as_it_lies() -> None:
    started = far(World("multi_agent/01").initial)
    assert list(started) == ["top bun", "cut lettuce", "cooked patty", "bottom bun", "table"]
    built = far(after("multi_agent/01", *CUT))
    assert list(built) == ["top bun", "cooked patty", "cut lettuce", "bottom bun", "table"]
    assert built["cut lettuce"].settled
    assert not built["cooked patty"].settled


def test_what_lies_on_something_unfinished_waits_for_it() -> None:
    """The lettuce that is not cut yet has to come out again, and so has all that lies on it."""
    whole = [line for line in CUT if line != "cut"]
    patty = [
        "move table4", "pick-up-item patty1", "move stove1", "place-item", "cook",
        "-", "-", "-", "-", "pick-up-item patty1", "move table2", "stack patty1 lettuce1",
    ]  # fmt: skip
    found = far(after("multi_agent/01", *whole, *patty))
    assert list(found)[1:3] == ["cooked patty", "cut lettuce"]
    assert found["cooked patty"] == LayerProgress(1, False)
    assert not found["cut lettuce"].settled


def test_no_tick_is_lost_where_two_dishes_are_alike() -> None:
    """Each dish stays where it is, whichever of them has become the better one, and what lies on
    one is no progress of the other."""
    task = load_task("synchronous/09")
    world = World(task)
    state = world.initial
    resolver = AppearanceResolver(task.domain, rendering_of(task))
    plain = dishes(world, resolver) or ()
    first, roots = fit(plain, state).holding, {}
    ticked: set[tuple[int, str]] = set()
    plan = next(task.folder.glob("09_*.plan")).read_text()
    for joint in read_plan(plan, world):
        state = state.step(list(joint)).state
        now = fit(plain, state)
        drawn = dishes(world, resolver, stack_levels(state, now)) or ()
        drawn, roots = kept_in_place(drawn, now.chosen, roots)
        found = {
            (number, layer.words)
            for number, dish in enumerate(drawn)
            for layer, row in zip(dish.layers, progress(dish, now.holding, first), strict=True)
            if row.settled
        }
        assert ticked <= found
        ticked = found
    assert len(ticked) == 12


def test_work_on_one_thing_fills_one_circle() -> None:
    pot = World("asynchronous/07")  # Three onions.
    state = pot.initial
    (dish,) = dishes(pot, AppearanceResolver(pot.task.domain, rendering_of(pot.task))) or ()
    for line in load_certificate("asynchronous/07").plan or ():
        now = fit((dish,), state).holding
        assert sum(share > 0 for share in shares(state, now)) <= 1
        action = pot.parse(state, pot.players[0], line)
        state = state.step(action).state
        if action.name == "boil-water":
            break
