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
from robotouille.episode.events import Moderation
from robotouille.errors import ProtocolError
from robotouille.replay.compression import compress
from robotouille.replay.recorder import HeaderDetails, Recorder, header

__all__ = ["random_stream", "talkative_stream", "write_recordings"]

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
    return _recorded(seed, clock, steps, tuple((labels or {}).items()), tuple(people))


@cache  # Many tests use the same recordings.
def _recorded(
    seed: int,
    clock: Clock | None,
    steps: int,
    labels: tuple[tuple[str, str], ...],
    people: tuple[tuple[str, str], ...],
) -> bytes:
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
        details=HeaderDetails(f"CODE-{seed}", "some-owner", dict(labels)),
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


def talkative_stream(person: tuple[str, str], spectator: str, session: str, words: str) -> bytes:
    """Return an unclosed recording in which a participant writes into every field and then leaves.

    Args:
        person: Name and pseudonym of the participant.
        spectator: Name of a spectator who chats.
        session: The participant's session.
        words: Part of all texts.
    """
    world = _world(Timing.BENCHMARK)
    rules = Rules(clock=Clock.LOCKSTEP, absence=Absence.END)
    episode, recorder = Episode(world, rules), Recorder(world)
    name, pseudonym = person
    head = header(
        world.task,
        rules,
        episode="talkative",
        seed=0,
        created="2026-01-01",
        details=HeaderDetails("CODE-0", "some-owner"),
    )
    stream = recorder.begin(head)
    first, second = world.players
    episode.join(first, name, "human", 0.0, session=session, participant=pseudonym)
    episode.join(second, "bot", "bot", 0.0)
    episode.tick(10.0)
    for seq, player in enumerate((first, second), 1):
        action = episode.state.actions(player)[0]
        episode.submit(player, ActionRequest(seq, action, reasoning=f"think {words}"), 10.0)
    episode.submit(first, ActionRequest(3, f"do {words}", reasoning=f"hope {words}"), 11.0)
    why = ProtocolError("message/malformed", f"unreadable {words}")
    episode.refuse(first, ActionRequest(4, f"refuse {words}"), why, 11.0)
    episode.note(first, f"topic {words}", f"note {words}", 11.0)
    episode.say(name, first, f"say {words}", 11.0)
    episode.say(spectator, "", f"watch {words}", 11.0)
    episode.moderate(Moderation.MUTED, session, pseudonym, name, 11.0)
    episode.announce(f"announce {words}", 11.0)
    episode.leave(first, 12.0)
    return stream + recorder.record(episode.events())


def write_recordings(folder: Path, count: int, *, first: int = 0, steps: int = 30) -> None:
    """Write closed recordings with consecutive seeds from `first`."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(first, first + count):
        content = compress(random_stream(seed, steps=steps))
        (folder / f"random{seed}.rbt").write_bytes(content)
