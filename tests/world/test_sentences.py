"""Sentences that name actions, and the conditions that they do not meet."""

from __future__ import annotations

from difflib import SequenceMatcher

import pytest

from robotouille import UnknownNameError, World
from robotouille.protocol import messages
from robotouille.protocol.states import why_row
from robotouille.world.text import MAX_ALIKE, MAX_SENTENCE
from robotouille.world.unmet import Unmet, UnmetKind, only_words, unmet_from
from tests.world.kitchens import kitchen

PATTY = {"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}
TWO_PLAYERS = [
    {"name": "robot", "x": 0, "y": 1, "direction": [0, -1]},
    {"name": "robot", "x": 2, "y": 1, "direction": [0, -1]},
]

MOVE = "Move robot1 from table1 to table2"
WAYS = [
    MOVE,
    f"{MOVE}.",
    f" {MOVE} . ",
    f"[{MOVE}]",
    f"({MOVE}).",
    f'"{MOVE}."',
    f"`{MOVE}`",
    f"“{MOVE}”",
    "['Move  robot1 from\ttable1 to table2.']",
    "move ROBOT1 FROM table1 to Table2",
    "move(robot1, table1, table2)",
    "Move( robot1,table1 , table2 ).",
    "[move('robot1', \"table1\", `table2`)]",
]
COOK = "Start cooking patty1 at stove1 with robot1"


@pytest.mark.parametrize("sentence", WAYS)
def test_valid_action_is_found_in_any_spelling(sentence: str) -> None:
    world = kitchen()
    action = world.parse(world.initial, "robot1", sentence)
    assert action is world.action("move", "robot1", "table1", "table2")
    assert world.initial.step(sentence) == world.initial.step(action)


@pytest.mark.parametrize("sentence", WAYS[1:])
def test_exact_reading_compares_every_character(sentence: str) -> None:
    world = kitchen()
    assert world.parse(world.initial, "robot1", MOVE, exact=True).sentence == MOVE
    with pytest.raises(UnknownNameError, match="did you mean 'Move robot1 from"):
        world.parse(world.initial, "robot1", sentence, exact=True)


@pytest.mark.parametrize("sentence", [COOK, f"[{COOK.upper()}.]", "cook(robot1, patty1, stove1)"])
def test_invalid_action_reports_unmet_conditions(sentence: str) -> None:
    world = kitchen(items=[PATTY])
    for ask in (world.initial.step, lambda text: world.parse(world.initial, "robot1", text)):
        with pytest.raises(UnknownNameError, match="now: needs: robot1 stands at stove1; needs: p"):
            ask(sentence)
    found = world.parse(world.initial, "robot1", sentence, valid=False)
    assert found is world.action("cook", "robot1", "patty1", "stove1")
    assert len(world.unmet(world.initial, found)) == 2


def test_action_of_another_player_is_not_valid() -> None:
    world = kitchen(players=TWO_PLAYERS)
    with pytest.raises(UnknownNameError, match="now: it is an action of robot1"):
        world.parse(world.initial, "robot2", MOVE)
    assert world.parse(world.initial, "robot2", MOVE, valid=False).player == "robot1"


def test_similar_valid_sentences_are_suggested() -> None:
    world = kitchen(items=[PATTY])
    with pytest.raises(UnknownNameError) as error:
        world.parse(world.initial, "robot1", "I think I move robot1 from table1 to tabel2!")
    listed = str(error.value).partition("did you mean ")[2]
    near = [part for part in listed.split("'") if part.startswith("Move")]
    sentences = [action.sentence for action in world.initial.actions("robot1")]
    assert len(near) == 3
    assert near[0] == MOVE
    assert set(near) <= set(sentences)


def test_suggestions_compare_few_of_many_sentences(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: set[str] = set()
    ratio = SequenceMatcher.ratio

    def noted(matcher: SequenceMatcher[str]) -> float:
        compared.add(str(matcher.a))
        return ratio(matcher)

    monkeypatch.setattr(SequenceMatcher, "ratio", noted)
    world = World("asynchronous/10")
    sentences = sorted(action.sentence for action in world.initial.actions("robot1"))
    assert len(sentences) > MAX_ALIKE
    for sentence in sentences:
        compared.clear()
        with pytest.raises(UnknownNameError, match=f"did you mean .*'{sentence}'"):
            world.parse(world.initial, "robot1", f"{sentence} quickly")
        assert len(compared) <= MAX_ALIKE


@pytest.mark.parametrize(
    "sentence",
    ["", ".", "()", "move", "move(", "move()", "move(robot1)", "move(robot1, table1, table2) now",
     "move(robot1, table1, tisch2)", "cook(robot1, stove1, patty1)", f"{MOVE} {MOVE}",
     "Move {p1} from {s1} to {s2}", "(" * 5_000, MOVE + " " * MAX_SENTENCE],
)  # fmt: skip
def test_other_texts_name_no_action(sentence: str) -> None:
    world = kitchen()
    for valid in (True, False):
        with pytest.raises(UnknownNameError, match="no valid action") as error:
            world.parse(world.initial, "robot1", sentence, valid=valid)
        assert len(str(error.value)) < 600


def test_ambiguous_sentence_raises_and_names_both_actions() -> None:
    world = alike()
    with pytest.raises(UnknownNameError, match=r"is ambiguous: .*\(.*\) or .*\(.*\)"):
        world.parse(world.initial, "robot1", "Go")
    with pytest.raises(UnknownNameError, match="is ambiguous"):
        world.parse(world.initial, "robot1", "Go", exact=True)
    with pytest.raises(UnknownNameError, match="is ambiguous"):
        world.initial.step("go.")
    first = world.initial.actions("robot1")[0]
    assert world.parse(world.initial, "robot1", str(first)) is first


def alike() -> World:
    """Return a kitchen in which the sentence of every walk is `Go`."""
    task = kitchen().task
    domain = task.domain.model_copy(
        update={
            "action_defs": tuple(
                action.model_copy(update={"language_description": "Go"})
                if action.name == "move"
                else action
                for action in task.domain.action_defs
            )
        }
    )
    return World(type(task)(task.name, domain, task.problem, task.seats))


def test_action_without_player_is_open_to_all_players() -> None:
    world = kitchen(players=TWO_PLAYERS)
    assert world.initial.step("do nothing.").attempts[0].applied


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
