"""Reasons are values with words: each kind, and the way back from words that were recorded."""

import pytest

from robotouille import World
from robotouille.episode import Episode, Rules
from robotouille.protocol import messages
from robotouille.world.unmet import Unmet, UnmetKind, from_words, only_words
from tests.world.kitchens import kitchen

PATTY = {"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}


def test_a_precondition_says_what_should_hold_of_which_objects() -> None:
    world = kitchen(items=[PATTY])
    first, second = world.unmet(world.initial, world.action("cook", "robot1", "patty1", "stove1"))
    assert (first.kind, first.predicate, first.objects, first.expected) == (
        UnmetKind.CONDITION,
        "loc",
        ("robot1", "stove1"),
        True,
    )
    assert str(first) == "needs: robot1 stands at stove1"
    assert second.predicate == "item_on"


def test_who_has_acted_is_named() -> None:
    world = kitchen(items=[PATTY])
    walk = world.action("move", "robot1", "table1", "table2")
    (unmet,) = world.initial.step([walk, walk]).attempts[1].unmet
    assert (unmet.kind, unmet.objects) == (UnmetKind.ACTED, ("robot1",))


@pytest.mark.parametrize("kind", UnmetKind)
def test_a_reason_comes_back_from_the_wire_as_it_went(kind: UnmetKind) -> None:
    unmet = Unmet(kind, "words", "loc", ("robot1", "table1"), expected=False)
    sent = messages.Why.of(unmet).model_dump(mode="json", exclude_defaults=True)
    assert messages.Why.model_validate(sent).value("words") == unmet


def test_a_kind_of_a_newer_server_is_another_kind() -> None:
    why = messages.Why.model_validate({"kind": "bored", "objects": ["robot1"]})
    assert why.value("robot1 is bored") == Unmet(
        UnmetKind.OTHER, "robot1 is bored", objects=("robot1",)
    )


@pytest.mark.parametrize(
    ("words", "kind", "objects"),
    [
        ("robot1 is busy for 1 more step", UnmetKind.BUSY, ("robot1",)),
        ("robot1 is busy for 4 more steps", UnmetKind.BUSY, ("robot1",)),
        ("bolt1 does not exist", UnmetKind.MISSING, ("bolt1",)),
        ("robot1 has acted in this step already", UnmetKind.ACTED, ("robot1",)),
        ("it is robot2's turn", UnmetKind.TURN, ("robot2",)),
        ("robot2 is not yours to move: you play robot1", UnmetKind.SEAT, ("robot2",)),
        ("superseded by action 7", UnmetKind.SUPERSEDED, ()),
        ("needs: lettuce1 is cut", UnmetKind.CONDITION, ()),
        ("lettuce1 is cut", UnmetKind.CONDITION, ()),
    ],
)
def test_recorded_words_are_understood(
    words: str, kind: UnmetKind, objects: tuple[str, ...]
) -> None:
    assert from_words(words) == (Unmet(kind, words, objects=objects),)


def test_recorded_words_of_a_negated_precondition() -> None:
    for words in ("must not be: lettuce1 is cut", "not: lettuce1 is cut"):
        (unmet,) = from_words(words)
        assert (unmet.kind, unmet.expected) == (UnmetKind.CONDITION, False)
    assert only_words("because")[0].kind is UnmetKind.OTHER


def test_words_of_an_episodes_own_reasons_are_understood() -> None:
    """What `from_words` knows is what is said: these come from an episode, not from a table."""
    world = World("multi_agent/01@2")
    episode = Episode(world, Rules())
    for number, player in enumerate(world.players):
        episode.join(player, f"bot{number}", "bot", 0.0)
    episode.events()
    foreign = world.initial.actions("robot2")[0]
    episode.submit("robot1", 1, foreign, 0.0)
    (rejected,) = [e for e in episode.events() if type(e).__name__ == "Rejected"]
    assert from_words(*rejected.reasons)[0].kind is rejected.unmet[0].kind is UnmetKind.SEAT
