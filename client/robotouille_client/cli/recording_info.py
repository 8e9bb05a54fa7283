"""Rows and texts of `robotouille replay info`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robotouille.replay.recording import Recording


def info_rows(recording: Recording) -> dict[str, Any]:
    """Return what a recording shows about the task, the participants and the outcome."""
    head, seats = recording.header, recording.measures().seats
    task = head["task"]
    return {
        "task": task["name"],
        "goal": task["problem"].get("goal_description", ""),
        "clock": head["rules"]["clock"],
        "timing": task["timing"],
        "sight": _sight(head["rules"]),
        "seed": head["seed"],
        "created": head["created"],
        "software": head["software"],
        "labels": head.get("labels", {}),
        "treated": head.get("treatments", {}),
        "seats": {p: f"{name} ({kind})" for p, (name, kind) in recording.participants.items()},
        "steps": recording.length,
        "rejected": {p: dict(sorted(seat.all_rejected.items())) for p, seat in seats.items()},
        "activities": {player: seat.activities for player, seat in seats.items()},
        "staleness": {player: seat.staleness for player, seat in seats.items()},
        "outcome": recording.outcome,
    }


def _sight(rules: dict[str, Any]) -> str:
    """Return in words how far players see."""
    tiles = rules.get("sight")
    far = "everything" if tiles is None else f"{tiles} tile{'s' * (tiles != 1)}"
    return f"{far} not behind stations" if rules.get("sight_blocked") else far


def info_texts(file: Path, rows: dict[str, Any]) -> dict[str, Any]:
    """Return the rows in words."""
    end = rows["outcome"]
    staleness = [f"{p}: {age:.1f} steps" for p, age in rows["staleness"].items() if age is not None]
    return {
        **rows,
        "seats": ", ".join(f"{player}: {who}" for player, who in rows["seats"].items()),
        "labels": ", ".join(f"{k}={v}" for k, v in rows["labels"].items()) or "-",
        "treated": _by_player(rows["treated"], "{0} {1}"),
        "rejected": _by_player(rows["rejected"], "{1} {0}"),
        "activities": _by_player(rows["activities"], "{1} {0}"),
        "staleness": ", ".join(staleness) or "-",
        "outcome": f"{end['reason']} after {end['seconds']} s" if end else no_outcome(file),
    }


def _by_player(rows: dict[str, dict[str, Any]], form: str) -> str:
    texts = {
        player: ", ".join(form.format(name, value) for name, value in row.items() if value)
        for player, row in rows.items()
    }
    return "; ".join(f"{player}: {text}" for player, text in texts.items() if text) or "-"


def no_outcome(file: Path) -> str:
    """Return why a recording has no outcome."""
    unfinished = file.suffix == ".part"
    return "no outcome: it is being played, or was left" if unfinished else "no outcome: cut off"
