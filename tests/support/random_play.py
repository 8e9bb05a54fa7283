"""Recordings of random play with all kinds of events: participants join, leave, are substituted,
request impossible actions, chat, and do nothing.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from robotouille import World, load_task
from robotouille.domain.task import Timing
from robotouille.episode import Absence, ActionRequest, Clock, Episode, Rules
from robotouille.errors import ProtocolError
from robotouille.replay.container import compress
from robotouille.replay.recorder import HeaderDetails, Recorder, header

__all__ = ["random_stream", "write_recordings"]

CLOCKS = (Clock.LOCKSTEP, Clock.REALTIME, Clock.TURN)


@cache
def _world(timing: Timing) -> World:
    return World(load_task("multi_agent/01@2", timing=timing))


def random_stream(
    seed: int,
    *,
    clock: Clock | None = None,
    steps: int = 30,
    labels: Mapping[str, str] | None = None,
    people: Sequence[tuple[str, str]] = (("name0", "p0"), ("name1", "p1")),
) -> bytes:
    """Return the bytes of an unclosed recording of a finished episode.

    Args:
        people: Name and pseudonym of each player.
    """
    rng = random.Random(seed)
    world = _world(rng.choice(list(Timing)))
    rules = Rules(
        clock=clock or CLOCKS[seed % len(CLOCKS)],
        absence=rng.choice([Absence.WAIT, Absence.BOT]),
        max_steps=steps,
        grace=0.5,
        move_budget=0.5,
    )
    episode, recorder = Episode(world, rules), Recorder(world)
    head = header(
        world.task,
        rules,
        episode=f"random{seed}",
        seed=seed,
        created="2026-01-01",
        details=HeaderDetails(f"CODE-{seed}", "some-owner", labels or {}),
    )
    stream = recorder.begin(head)
    for player, (name, pseudonym) in zip(world.players, people, strict=True):
        episode.join(player, name, "human", 0.0, participant=pseudonym)
    now, seq = 0.0, 0
    while not episode.ended and now < 1000:
        now, seq = now + 0.1, seq + 1
        for player in world.players:
            with suppress(ProtocolError):
                _do_something(episode, player, seq, now, rng)
        episode.tick(now)
        stream += recorder.record(episode.events())
    return stream


def _do_something(episode: Episode, player: str, seq: int, now: float, rng: random.Random) -> None:
    valid = episode.state.actions(player)
    action: Any = rng.choice(valid) if valid else None
    match rng.randrange(12):
        case 0:
            episode.set_present(player, rng.random() < 0.7, now)
        case 1:
            episode.submit(player, ActionRequest(seq, "no action at all"), now)
        case 2:
            episode.submit(
                player,
                ActionRequest(seq, rng.choice(episode.state.world.ground_actions(player))),
                now,
            )
        case 3:
            episode.submit(player, ActionRequest(seq), now)
        case 4:
            episode.say("name", player, rng.choice(["hello", "\x1b[2J", "=1+1", "\x00"]), now)
        case 5 | 6:
            episode.substitute(player, action, now)
        case 7 | 8 | 9:
            episode.submit(
                player,
                ActionRequest(seq, action, basis=max(0, episode.step - rng.randrange(3))),
                now,
            )


def write_recordings(folder: Path, count: int, *, first: int = 0, steps: int = 30) -> None:
    """Write closed recordings with consecutive seeds from `first`."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(first, first + count):
        content = compress(random_stream(seed, steps=steps))
        (folder / f"random{seed}.rbt").write_bytes(content)
