"""Schema of frames: unknown, missing and invalid fields are refused by name."""

from __future__ import annotations

import pytest

from robotouille import RecordingError
from robotouille.replay.container import frame_ends, pack_frame, read_frames
from robotouille.replay.frame_schema import (
    MAX_PLAYERS,
    MAX_REASONS,
    MAX_TIMERS,
    check_frame,
)
from robotouille.replay.recording import Recording
from tests.support.games import recorded_game

GAME = recorded_game("synchronous/01", seed=1, steps=5)
BEGINNING = GAME[: list(frame_ends(GAME))[-2]]


@pytest.mark.parametrize(
    "field",
    [
        {"kind": "notes", "notes": [{"note": "started", "t": 0}], "more": 1},
        {"kind": "notes", "notes": [{"note": "started", "t": 0, "more": 1}]},
        {"kind": "step", "step": 6, "t": 1, "moves": [], "more": 1},
    ],
)
def test_unknown_fields_are_refused(field: dict[str, object]) -> None:
    with pytest.raises(RecordingError, match="more: Extra inputs"):
        Recording(BEGINNING + pack_frame(field))


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        ({"kind": "poem"}, "frame 7: "),
        ({"kind": "notes", "notes": [{"note": "started"}]}, "notes.0.started.t: Field required"),
        ({"kind": "notes", "notes": [{"note": "quota", "t": "1", "player": ""}]}, "quota.t: Input"),
        ({"kind": "step", "step": 0, "t": 1, "moves": []}, "step: Input should be greater"),
        (
            {"kind": "notes", "notes": [{"note": "countdown", "t": 1, "ms": None}]},
            "notes.0.countdown.ms: Input should be a valid integer",
        ),
        (
            {
                "kind": "step",
                "step": 1,
                "t": 1,
                "moves": [{"player": "r", "action": ["a"], "seq": 1, "ms": 1, "basis": None}],
            },
            "moves.0.basis: Input should be a valid integer",
        ),
    ],
)
def test_invalid_field_is_named(frame: dict[str, object], fault: str) -> None:
    with pytest.raises(RecordingError, match=fault):
        check_frame(frame, 7)


@pytest.mark.parametrize(
    ("kind", "path", "value", "field"),
    [
        ("step", ("t",), -1, "t"),
        ("step", ("t",), 2**63 - 1, "t"),
        ("step", ("late",), 2**63 - 1, "late"),
        ("footer", ("utc_ms",), 2**63 - 1, "utc_ms"),
        ("footer", ("clock_ms",), -(2**62), "clock_ms"),
        ("footer", ("outcome", "seconds"), float("inf"), "outcome.seconds"),
        ("footer", ("outcome", "seconds"), -1.0, "outcome.seconds"),
    ],
)
def test_impossible_times_are_refused(
    kind: str, path: tuple[str, ...], value: float, field: str
) -> None:
    game = recorded_game("synchronous/01", seed=1, steps=5)
    frame = next(each for each in read_frames(game) if each["kind"] == kind)
    place = frame
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(RecordingError, match=rf"frame 3: {kind}\.{field}: "):
        check_frame(frame, 3)


PLAYERS = [f"robot{number}" for number in range(MAX_PLAYERS + 1)]
MOVE = {"player": "robot1", "action": ["wait"], "seq": 1, "ms": 1}
STEP = {"kind": "step", "step": 1, "t": 1, "moves": []}
STATE = {"kind": "state", "step": 1, "hash": "", "facts": [], "timers": [], "busy": {}}


@pytest.mark.parametrize(
    "frame",
    [
        {**STEP, "moves": [MOVE] * (MAX_PLAYERS + 1)},
        {**STEP, "waits": PLAYERS},
        {**STEP, "idle": [["robot1", 1]] * (MAX_PLAYERS + 1)},
        {**STEP, "busy": dict.fromkeys(PLAYERS, 1)},
        {**STEP, "unmet": {player: ["no"] for player in PLAYERS}},
        {**STEP, "unmet": {"0": ["no"] * (MAX_REASONS + 1)}},
        {**STEP, "timers": {str(number): [1] for number in range(MAX_TIMERS + 1)}},
        {**STATE, "timers": [["cook.0()", [1]]] * (MAX_TIMERS + 1)},
        {**STATE, "busy": dict.fromkeys(PLAYERS, 1)},
        {"kind": "notes", "notes": [{"note": "paused", "t": 0, "holds": PLAYERS[:101]}]},
    ],
)
def test_frame_of_more_than_any_kitchen_has_is_refused(frame: dict[str, object]) -> None:
    with pytest.raises(RecordingError, match="should have at most"):
        check_frame(frame, 7)


def test_end_with_an_impossible_time_is_refused() -> None:
    """A time that becomes infinite in milliseconds ended `replay info` with a traceback."""
    outcome = {"reason": "goal", "steps": 1, "seconds": 1.7e308, "detail": "", "seats": []}
    with pytest.raises(RecordingError, match=r"outcome\.seconds"):
        check_frame({"kind": "footer", "outcome": outcome}, 7)
