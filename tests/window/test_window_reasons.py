"""Texts of pauses, farewells, rates and paths."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille.episode import PauseReason
from robotouille.protocol.messages import SeatInfo
from robotouille_client.window.sources.texts import (
    clock_words,
    comings_and_goings,
    farewell,
    outcome_words,
    path_words,
    pause_words,
    rate_words,
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
        ("absence", (True, False, True), 22.1, "bob lost the connection", "23 s"),
        ("absence", (True, False, False), 3.0, "bob and carol lost the connection", "3 s"),
        ("restart", (True, False, True), 9.0, "The server restarted", "9 s for bob."),
        ("restart", (False, False, True), None, "The server restarted", "ada and bob"),
        ("restart", (True, True, True), 9.0, "The server restarted", "the others"),
        ("operator", (True, True, True), None, "Paused by the operator", "resume"),
        ("storage", (True, True, True), None, "The recording can't be saved", "Nothing is lost"),
        ("deserted", (False, False, False), 5.5, "Everyone is away", "6 s"),
        ("eclipse", (True, True, True), 5.5, "Paused", "Eclipse"),
    ],
)
def test_pauses(
    reason: str, here: tuple[bool, ...], left: float | None, why: str, detail: str
) -> None:
    found = pause_words(reason, seats(*here), left)
    assert found[0] == why
    assert detail in found[1]


def test_every_pause_reason_has_a_text() -> None:
    titles = {pause_words(hold.value, seats(True, False, True), 5.0)[0] for hold in PauseReason}
    assert len(titles) == len(PauseReason)
    assert "Paused" not in titles


def test_a_free_seat_is_named() -> None:
    free = [*seats(True, True, True), SeatInfo(player="robot4")]
    assert pause_words("absence", free, 5.0)[0] == "Nobody is playing robot4"


def test_known_codes_have_texts_and_others_show_the_reason() -> None:
    known = farewell("session/elsewhere", "whatever the server says")
    assert known.title == "You are playing in another window"
    assert farewell("", "removed by the operator").text == "Removed by the operator."
    assert farewell("x/y", "You cheated!").text == "You cheated!"
    assert farewell("", "  ").text == "The connection was closed."


def test_an_outcome_includes_its_detail() -> None:
    outcome = {"reason": "abandoned", "steps": 4, "detail": "bob did not come back"}
    assert outcome_words(outcome) == "Abandoned after 4 steps: bob did not come back"


def test_changes_of_other_seats_are_listed() -> None:
    def changes(
        before: list[SeatInfo], now: list[SeatInfo], me: str | None = "robot1"
    ) -> list[str]:
        return comings_and_goings(before, now, me)

    two, free = seats(True, True), [seats(True)[0], SeatInfo(player="robot2")]
    assert changes(free, two) == ["bob joined"]
    assert changes(two, free) == ["bob left"]
    assert changes(two, seats(False, False)) == ["bob is away"]
    assert changes(seats(True, False), two) == ["bob is back"]
    assert changes(two, [two[0], renamed(two[1], name="carol")]) == ["bob left", "carol joined"]
    assert changes([], two) == changes(two, two) == []
    unready = [renamed(two[0], ready=False), two[1]]
    assert changes(unready, two, None) == ["ada is ready"]
    assert changes(two, unready, None) == ["ada is no longer ready"]
    assert changes(unready, two) == []


def renamed(seat: SeatInfo, **fields: object) -> SeatInfo:
    return seat.model_copy(update=fields)


def test_waiting_words() -> None:
    assert waiting_words(seats(True, True), 2.2) == "Starting in 3"
    assert waiting_words(seats(True, True), 0.0) == "Go!"
    assert waiting_words(seats(True, False), None) == "Waiting for bob"
    free = [*seats(True), SeatInfo(player="robot2"), SeatInfo(player="robot3")]
    assert waiting_words(free, None) == "Waiting for 2 more players"
    unready = [renamed(seat, ready=False) for seat in seats(True, True)]
    assert waiting_words(unready, None, "robot1") == "Waiting for you to get ready"
    assert waiting_words(unready, None, "robot3") == "Waiting for ada and bob to get ready"


def test_spectators_are_marked_in_the_chat() -> None:
    assert speaker("ada", "robot1") == "ada"
    assert speaker("bob", "") == "bob (watching)"


@pytest.mark.parametrize(
    ("rate", "words"),
    [(1.0, "1 step a second"), (5.0, "5 steps a second"), (0.5, "0.5 steps a second")],
)
def test_singular_and_plural_steps(rate: float, words: str) -> None:
    assert rate_words(rate) == words
    assert clock_words("realtime", {"step_rate": rate}, 2) == f"real time, {words}"


@pytest.mark.parametrize(
    ("clock", "players", "words"),
    [
        ("turn", 1, "no hurry, 30 s a move"),
        ("turn", 2, "taking turns, 30 s a move"),
        ("lockstep", 2, "all move at once, 30 s a move"),
        ("realtime", 1, "real time, 30 s a move"),
    ],
)
def test_clocks_have_words_for_players(clock: str, players: int, words: str) -> None:
    assert clock_words(clock, {"move_budget": 30}, players) == words


def test_the_home_folder_is_a_tilde(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    assert path_words(tmp_path / "a" / "b.png") == "~/a/b.png"
    assert path_words(tmp_path.parent / "b.png") == str(tmp_path.parent / "b.png")
