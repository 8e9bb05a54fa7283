"""The ticket: dishes from any domain's goal, ticked off as they are finished."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pygame
import pytest
from tests.support.samples import quick_sample
from tests.support.scripted import after, planned
from tests.support.window_play import world_of

from robotouille import State, World, load_task, task_names
from robotouille.certification.certificate import load_certificate
from robotouille.domain.rendering import NO_WORDS, Language, rendering_of
from robotouille.domain.schema import GoalTerm
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.side_panel.ticket import (
    LayerProgress,
    as_at_first,
    fit,
    kept_in_place,
    progress,
    shares,
    stack_levels,
)
from robotouille_client.window.drawing.window_layout import UiOverlay
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.dishes import Dish, dishes
from robotouille_client.window.view import View

SIZE = (1280, 720)


def drawn(name: str) -> tuple[Dish, ...]:
    world = world_of(name)
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


WITH_GOAL = [name for name in task_names() if not name.startswith("shifts/")]


@pytest.mark.parametrize("name", quick_sample(WITH_GOAL, 10))
def test_every_term_is_on_the_ticket_once(name: str) -> None:
    numbers = [n for dish in drawn(name) for layer in dish.layers for n in layer.terms]
    assert sorted(numbers) == list(range(len(world_of(name).goal.terms)))


def settled(name: str) -> Iterator[dict[str, bool]]:
    """Yield which layers are ticked before and after each step of a plan for two."""
    for state in planned(name, 2):
        yield {words: row.settled for words, row in far(state).items()}


def test_ticks_go_from_none_to_all() -> None:
    for name in ("multi_agent/01", "multi_agent/07"):
        first, *course = settled(name)
        assert not any(first.values())
        before: dict[str, bool] = {}
        for now in course:
            assert all(now[words] for words, done in before.items() if done)
            before = now
        assert all(before.values())


def test_tooltips_explain_each_layer() -> None:
    world = world_of("multi_agent/01")
    painter, surface = Painter(), pygame.Surface(SIZE)
    painter.paint(surface, View(world, world.initial))
    x = painter.layout(SIZE, world).panel.left + 60
    received = {line for y in range(60, 300) for line in painter.tooltip((x, y))}
    assert "Not yet: the lettuce has been cut." in received
    assert "Ready: the bottom bun lies directly on the table." in received
    assert world.task.goal_description in received


def test_a_goal_that_cannot_be_drawn_is_in_words() -> None:
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


def test_the_tooltip_of_the_ticket_is_the_goal_in_words() -> None:
    world = world_of("multi_agent/07")
    view = View(world, world.initial)
    place = Painter().layout(SIZE, world)
    on_the_ticket = (place.panel.left + 60, 120)
    assert shown(view, on_the_ticket) != shown(view) == shown(view, (5, 5))


def test_real_time_games_show_the_seconds_left() -> None:
    world = world_of("multi_agent/07")
    view = View(world, world.initial, step=20, max_steps=80)
    timed = replace(view, step_seconds=0.2)
    assert shown(timed) != shown(view)
    assert shown(timed) != shown(replace(timed, step_seconds=0.5))


def test_hovering_lists_the_contents_of_a_pot() -> None:
    state = planned("multi_agent/07", 4, 15)[-1]
    world, stage = state.world, Painter().stage(state)
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    words = [words for _, words in resolver.listing(stage, "stove1")]
    assert words[0] == "pot"
    assert {"cut tomato", "potato"} < set(words)


def test_hovering_counts_equal_things_of_a_crate() -> None:
    state = world_of("shifts/01").initial
    stage = Painter().stage(state)
    resolver = AppearanceResolver(state.world.task.domain, rendering_of(state.world.task))
    (bread,) = resolver.listing(stage, "crate1")
    assert bread[1] == "bread × 6"


def test_the_ticket_uses_the_players_own_words() -> None:
    world = world_of("multi_agent/01")
    words = Language.model_validate({"kinds": {"lettuce": "Salat"}})

    def ticket(*laid_over: Language) -> bytes:
        surface = pygame.Surface((1280, 720))
        painter = Painter(words=laid_over[0]) if laid_over else Painter()
        painter.paint(surface, View(world, world.initial))
        return pygame.image.tobytes(surface, "RGB")

    assert ticket(words) != ticket() == ticket(NO_WORDS)


def test_the_circle_fills_with_each_cut() -> None:
    world = world_of("training/01")
    state, seen = world.initial, []
    for line in load_certificate("training/01").plan or ():
        action = world.parse(state, world.players[0], line)
        state = state.step(action).state
        if action.name == "cut":
            seen.append(max(shares(state, world.goal.holding(state.facts))))
    assert seen[0] > 0.3
    assert seen[1] > 0.6
    assert seen[2] == 0.0, "a finished term has no share"


def layers(state: State) -> list[LayerProgress]:
    """Return the progress of each layer of a one-dish goal, from the top down."""
    resolver = AppearanceResolver(state.world.task.domain, rendering_of(state.world.task))
    plain = dishes(state.world, resolver) or ()
    now, first = (fit(plain, each) for each in (state, state.world.initial))
    return list(progress(plain[0], now.holding, as_at_first(state, now, first.holding)))


def far(state: State) -> dict[str, LayerProgress]:
    """Return the progress of each layer of a one-dish goal, from the top down."""
    world = state.world
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    plain = dishes(world, resolver) or ()
    now, first = (fit(plain, each) for each in (state, world.initial))
    (dish,) = dishes(world, resolver, stack_levels(state, now)) or ()
    before = as_at_first(state, now, first.holding)
    found = progress(dish, now.holding, before, shares(state, now.holding))
    return {layer.words: row for layer, row in zip(dish.layers, found, strict=True)}


HOLDING_THE_BASE = ["pick-up-item bottombun1"]


def test_an_arbitrary_table_is_no_progress() -> None:
    """Any table will do, so that the one under the top bun does not count as progress."""
    before = far(world_of("multi_agent/01").initial)
    held = far(after("multi_agent/01", *HOLDING_THE_BASE))
    assert all(row.share == 0 for row in before.values())
    assert all(row == LayerProgress(0, False) for name, row in held.items() if "bun" not in name)
    assert held["top bun"].share == 0


@pytest.mark.parametrize("bread", ["bread1", "bread2"])
def test_a_base_that_was_put_on_another_table_is_ticked(bread: str) -> None:
    task, tables = "training/01", {"bread1": "table1", "bread2": "table2"}
    held = [f"move {tables[bread]}", f"pick-up-item {bread}", "move table4"]
    assert not any(row.settled for row in layers(after(task, *held)))
    top, *_, base, _ = layers(after(task, *held, "place-item"))
    assert base.settled
    assert not top.settled


CUT = [
    "move table6", "pick-up-item lettuce1", "move board1", "place-item", "cut", "cut", "cut",
    "pick-up-item lettuce1", "move table2", "stack lettuce1 bottombun1",
]  # fmt: skip


def test_layers_of_free_order_are_drawn_as_they_lie() -> None:
    started = far(world_of("multi_agent/01").initial)
    assert list(started) == ["top bun", "cut lettuce", "cooked patty", "bottom bun", "table"]
    built = far(after("multi_agent/01", *CUT))
    assert list(built) == ["top bun", "cooked patty", "cut lettuce", "bottom bun", "table"]
    assert built["cut lettuce"].settled
    assert not built["cooked patty"].settled


def test_layers_on_unfinished_ones_wait() -> None:
    """The uncut lettuce must come out again, and everything on top of it as well."""
    whole = [line for line in CUT if line != "cut"]
    patty = [
        "move table4", "pick-up-item patty1", "move stove1", "place-item", "cook",
        "-", "-", "-", "-", "pick-up-item patty1", "move table2", "stack patty1 lettuce1",
    ]  # fmt: skip
    found = far(after("multi_agent/01", *whole, *patty))
    assert list(found)[1:3] == ["cooked patty", "cut lettuce"]
    assert found["cooked patty"] == LayerProgress(1, False)
    assert not found["cut lettuce"].settled


@pytest.mark.slow
def test_equal_dishes_keep_their_ticks() -> None:
    """Each dish keeps its place, even if the other one gets ahead."""
    state, *course = planned("synchronous/09", 1)
    world = state.world
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    plain = dishes(world, resolver) or ()
    first, roots = fit(plain, state).holding, {}
    ticked: set[tuple[int, str]] = set()
    for state in course:
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


def test_a_finished_dish_is_ticked_as_itself_in_any_order() -> None:
    """The second dish of the goal is finished first; its soup counts for no other dish."""
    task = load_task("multi_agent/10", seats=4)
    kinds = {"tomato": "cheese", "chicken": "onion", "cheese": "tomato", "onion": "chicken"}
    swapped = tuple(
        term.model_copy(update={"args": tuple(kinds.get(kind, kind) for kind in term.args)})
        for term in task.problem.goal
    )
    world = World(replace(task, problem=task.problem.model_copy(update={"goal": swapped})))
    resolver = AppearanceResolver(world.task.domain, rendering_of(world.task))
    plain = dishes(world, resolver) or ()
    at_first, ticks, finished = fit(plain, world.initial).holding, 0, []
    for planned_state in planned("multi_agent/10", 4):
        state = world.restore(planned_state.facts, planned_state.timer_rows(), ())
        now = fit(plain, state)
        assert sum(now.holding) >= ticks, "no tick vanishes"
        ticks = sum(now.holding)
        finished.append(
            [
                all(layer.settled for layer in progress(dish, now.holding, at_first))
                for dish in dishes(world, resolver, stack_levels(state, now)) or ()
            ]
        )
    assert [False, True] in finished
    assert [True, False] not in finished
    assert finished[-1] == [True, True]


def test_work_on_one_object_counts_once() -> None:
    pot = world_of("asynchronous/07")  # Three onions.
    state = pot.initial
    (dish,) = dishes(pot, AppearanceResolver(pot.task.domain, rendering_of(pot.task))) or ()
    for line in load_certificate("asynchronous/07").plan or ():
        now = fit((dish,), state).holding
        assert sum(share > 0 for share in shares(state, now)) <= 1
        action = pot.parse(state, pot.players[0], line)
        state = state.step(action).state
        if action.name == "boil-water":
            break
