"""Reasons for rejections are values with words."""

import pytest

from robotouille.protocol import messages
from robotouille.protocol.states import why_row
from robotouille.world.unmet import Unmet, UnmetKind, only_words, unmet_from
from tests.world.kitchens import kitchen

PATTY = {"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}


def test_precondition_names_predicate_and_objects() -> None:
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


@pytest.mark.parametrize("kind", UnmetKind)
def test_reason_survives_the_protocol(kind: UnmetKind) -> None:
    unmet = Unmet(kind, "words", "loc", ("robot1", "table1"), expected=False)
    sent = messages.Why.of(unmet).model_dump(mode="json", exclude_defaults=True)
    assert messages.Why.model_validate(sent).value("words") == unmet


def test_kind_of_a_newer_server_becomes_other() -> None:
    why = messages.Why.model_validate({"kind": "bored", "objects": ["robot1"]})
    assert why.value("robot1 is bored") == Unmet(
        UnmetKind.OTHER, "robot1 is bored", objects=("robot1",)
    )


def test_reasons_survive_a_recording() -> None:
    reasons = (
        Unmet(UnmetKind.BUSY, "robot1 is busy for 4 more steps", objects=("robot1",)),
        Unmet(UnmetKind.CONDITION, "must not be: lettuce1 is cut", "iscut", ("lettuce1",), False),
    )
    rows = [why_row(each) for each in reasons]
    assert unmet_from([str(each) for each in reasons], rows) == reasons


def test_kind_of_a_newer_version_becomes_other() -> None:
    assert unmet_from(["robot1 is bored"], [{"kind": "bored"}]) == only_words("robot1 is bored")
