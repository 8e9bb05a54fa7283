"""Valid messages, recordings and files that fuzzing starts from."""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import Any

from tools.message_examples import EXAMPLES

from robotouille.episode import Clock
from robotouille.installation import data_folder
from robotouille.protocol import messages
from robotouille.replay.compression import compress
from tests.support.games import recorded_game

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = [
    "FILE_KINDS",
    "MESSAGE_KINDS",
    "client_messages",
    "files",
    "recordings",
    "server_messages",
]

MESSAGE_KINDS = ("client-json", "client-msgpack", "server-json", "server-msgpack")
FILE_KINDS = (
    "domain", "problem", "input", "rendering", "plan", "certificate", "rows", "run", "labels",
    "codebook", "annotations", "export",
)  # fmt: skip

MORE: tuple[dict[str, Any], ...] = (
    {"type": "hello", "protocol": 1, "name": "eve", "kind": "human", "ref": 1},
    {"type": "hello", "protocol": 1, "name": "eve", "resume": "0" * 32},
    {"type": "create", "task": "synchronous/01", "clock": "turn", "max_steps": 3, "ref": 5},
    {"type": "create", "task": "workshop/02", "clock": "lockstep", "seed": 7},
    {"type": "create", "clock": "realtime", "thinking": "declared", "move_budget": 0.5},
    {"type": "join", "episode": "AAAAA", "role": "spectator", "view": "text", "known": ["a"]},
    {"type": "act", "seq": 1, "action": None},
    {"type": "act", "seq": 2, "action": 3, "basis": 0},
    {"type": "act", "seq": 3, "action": "Move robot1 from table1 to table2", "think_ms": 10},
    {"type": "join", "episode": "AAAAA", "seats": "all", "ref": 9},
    {"type": "join", "episode": "AAAAA", "seats": ["robot1", "robot2"], "view": "both"},
    {"type": "act", "seq": 4, "action": None, "seat": "robot2"},
    {"type": "note", "topic": "plan", "text": "cut", "seat": "robot2", "more": True},
    {"type": "leave"},
)


def _of(models: tuple[type[messages.Message], ...]) -> list[dict[str, Any]]:
    return [EXAMPLES[str(model.model_fields["type"].default)] for model in models]


@cache
def client_messages() -> tuple[dict[str, Any], ...]:
    """Return one message of each type that a client sends, with variants."""
    return (*_of(messages.CLIENT_MESSAGES), *MORE)


@cache
def server_messages() -> tuple[dict[str, Any], ...]:
    """Return one message of each type that the server sends."""
    return tuple(_of(messages.SERVER_MESSAGES))


@cache
def recordings() -> tuple[bytes, ...]:
    """Return recordings of short episodes open and closed."""
    games = (
        recorded_game("synchronous/01", seed=1, clock=Clock.TURN, steps=12),
        recorded_game("workshop/02", seed=2, clock=Clock.LOCKSTEP, steps=110),
        recorded_game("multi_agent/10@3", seed=3, clock=Clock.LOCKSTEP, steps=25),
        recorded_game("asynchronous/06", seed=4, clock=Clock.REALTIME, steps=20, timing="people"),
    )
    return (*games, compress(games[0]), zstd.compress(games[0]))


FOLDERS = {
    "domain": ("domains", ("robotouille.json", "workshop.json")),
    "input": ("domains", ("robotouille.input.json",)),
    "problem": (
        "problems",
        (
            "synchronous/01_cheese_sandwich.json",
            "asynchronous/06_potato_soup.json",
            "workshop/02_two_workers.json",
        ),
    ),
    "rendering": ("renderings", ("robotouille.json",)),
    "plan": ("problems", ("synchronous/01_cheese_sandwich.plan", "workshop/01_painted_gear.plan")),
    "certificate": ("problems", ("synchronous/01_cheese_sandwich.certificate.json",)),
}


PACK = {"name": "p", "version": "1", "digest": "0" * 64}
ROW = {
    "run": "r", "job": "j", "pack": PACK, "dataset": "synchronous", "task": "synchronous/01",
    "instance": "synchronous/01", "agent": "react (m)", "seats": 2, "recording": "recordings/j.rbt",
    "real_time": {"step_rate": 5.0, "charge": "tokens:20", "late": "apply"},
    "budget": {"rule": "own", "steps": 30}, "optimum": {"steps": 20, "bound": 20, "proven": True},
    "outcome": {"success": True, "steps": 25, "ended_by": "goal"},
    "counts": {"invalid": 1, "calls": 9}, "usage": {"prompt_tokens": 900, "cost": 0.1},
    "seconds": 3.5, "repetitions": 2,
    "measures": {
        "to_go_least": 0.5, "to_go_most": 0.5, "waiting_share": 0.1, "staleness": 1.5,
        "late_answers": 1, "contributions": {"robot1": 0.4, "robot2": 0.6},
        "failure": {"category": "goal", "subcategory": "none", "steps": [3, 4]},
    },
}  # fmt: skip
JOB = {
    "agent": {"name": "planner", "kind": "planner"}, "instance": "synchronous/01", "seats": 1,
    "seed": 0, "budget": "own",
}  # fmt: skip
ANNOTATIONS = {
    "format": 1, "coder": "meg", "recording": "r", "task": "soup", "steps": 9,
    "labels": ["help", "wait"], "annotations": [{"label": "help", "first": 2, "last": 4}],
}  # fmt: skip
EXPORT = {
    "about": {"title": "T", "description": "D", "license": "CC-BY-4.0", "contact": "C"},
    "formats": ["csv"], "episodes": 1, "seats": 2, "steps": 9, "tasks": {"soup": 1},
    "data": [{"part": "", "format": "csv", "entry": "steps", "path": "steps.csv", "rows": 9}],
    "labels": {"condition": 2}, "split": {}, "recorded_by": {"1.0": 1}, "labels_asked": {},
    "consent": {}, "query": "", "software": "1.0", "catalogue": "2", "left_out": {}, "faults": {},
    "names": True, "texts": True,
}  # fmt: skip
VALUES: dict[str, Any] = {
    "rows": ROW,
    "run": {
        "format": "robotouille-run/1", "name": "r", "pack": PACK, "pack_folder": "pack",
        "jobs": [JOB, {**JOB, "seed": 1}], "software": "1.0",
    },
    "labels": [{"recording": "recordings/j.rbt", "category": "goal", "note": "n"}],
    "codebook": {"labels": [{"id": "help", "title": "Helps", "key": "h"}]},
    "annotations": ANNOTATIONS,
    "export": EXPORT,
}  # fmt: skip
"""Files that only commands write, as JSON values."""


@cache
def files(kind: str) -> tuple[bytes, ...]:
    """Return valid files of a kind, shipped or as a command writes them."""
    if kind in VALUES:
        return (json.dumps(VALUES[kind]).encode(),)
    folder, names = FOLDERS[kind]
    return tuple((data_folder(folder) / name).read_bytes() for name in names)
