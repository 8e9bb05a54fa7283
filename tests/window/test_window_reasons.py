"""Pauses and farewells in words."""

from __future__ import annotations

import pytest

from robotouille.episode import PauseReason
from robotouille.protocol.messages import SeatInfo
from robotouille_client.window.sources.texts import (
    comings_and_goings,
    farewell,
    outcome_words,
    pause_words,
    speaker,
    waiting_words,
)


def seats(*present: bool) -> list[SeatInfo]:
    names = ("ada", "bob", "carol")
    return [
        SeatInfo(player=f"robot{i}", name=name, kind="human", present=here)
        for i, (name, here) in enumerate(zip(names, present, strict=False), 1)
    ]


@pytest.mark.parametrize(
    ("reason", "here", "left", "why", "detail"),
    [
        ("absence", (True, False, True), 22.1, "bob's connection is lost", "23 s"),
        ("absence", (True, False, False), 3.0, "bob and carol have lost their connections", "3 s"),
        ("restart", (True, False, True), 9.0, "The server was restarted", "9 s for bob."),
        ("restart", (False, False, True), None, "The server was restarted", "ada and bob"),
        ("restart", (True, True, True), 9.0, "The server was restarted", "the others"),
        ("operator", (True, True, True), None, "Paused by the operator", "goes on"),
        ("storage", (True, True, True), None, "The recording cannot be written", "Nothing is lost"),
        ("deserted", (False, False, False), 5.5, "Everybody is away", "6 s"),
        ("eclipse", (True, True, True), 5.5, "The game stands still", "eclipse"),
    ],
)
def test_pauses(
    reason: str, here: tuple[bool, ...], left: float | None, why: str, detail: str
) -> None:
    found = pause_words(reason, seats(*here), left)
    assert found[0] == why
    assert detail in found[1]


def test_every_reason_of_the_protocol_has_words_of_its_own() -> None:
    titles = {pause_words(hold.value, seats(True, False, True), 5.0)[0] for hold in PauseReason}
    assert len(titles) == len(PauseReason)
    assert "The game stands still" not in titles


def test_a_seat_that_nobody_has_is_named() -> None:
    free = [*seats(True, True, True), SeatInfo(player="robot4")]
    assert pause_words("absence", free, 5.0)[0] == "Nobody plays robot4"


def test_codes_have_words_and_other_reasons_are_the_servers() -> None:
    known = farewell("session/elsewhere", "whatever the server says")
    assert known.title == "This seat is now played from another window"
    assert farewell("", "removed by the operator").text == "Removed by the operator."
    assert farewell("x/y", "You cheated!").text == "You cheated!"
    assert farewell("", "  ").text == "The connection was closed."


def test_an_outcome_names_what_it_came_from() -> None:
    outcome = {"reason": "abandoned", "steps": 4, "detail": "bob did not come back"}
    assert outcome_words(outcome) == "Given up after 4 steps: bob did not come back"


def test_who_comes_and_goes_is_told_but_of_oneself() -> None:
    def told(before: list[SeatInfo], now: list[SeatInfo]) -> list[str]:
        return comings_and_goings(before, now, "robot1")

    two, free = seats(True, True), [seats(True)[0], SeatInfo(player="robot2")]
    assert told(free, two) == ["bob joins"]
    assert told(two, free) == ["bob has left"]
    assert told(two, seats(False, False)) == ["bob is away"]
    assert told(seats(True, False), two) == ["bob is back"]
    other = [two[0], two[1].model_copy(update={"name": "carol"})]
    assert told(two, other) == ["bob has left", "carol joins"]
    assert told([], two) == told(two, two) == []


def test_what_a_game_waits_for_before_it_begins() -> None:
    assert waiting_words(seats(True, True), 2.2) == "Starts in 3"
    assert waiting_words(seats(True, True), 0.0) == "Starts now"
    assert waiting_words(seats(True, False), None) == "Waiting for bob"
    free = [*seats(True), SeatInfo(player="robot2"), SeatInfo(player="robot3")]
    assert waiting_words(free, None) == "Waiting for 2 more players"


def test_what_a_watcher_says_is_marked() -> None:
    assert speaker("ada", "robot1") == "ada"
    assert speaker("bob", "") == "bob (watching)"
