"""Draw docs/images/replay.png: a recording in the viewer with the log and remaining steps.

python tools/picture_replay.py [OUT.png]

The tool plays the game itself with seeded randomness, so the picture is always the same.
"""

from __future__ import annotations

import argparse
import os
import random
import tempfile
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame

from robotouille import World
from robotouille.certification.certificate import Deadline
from robotouille.episode import Absence, ActionRequest, Clock, Episode, Rules
from robotouille.planning.policies import PlannerOptions, PlannerPolicy
from robotouille.planning.solvers import AnytimePlanner
from robotouille.replay.compression import compress
from robotouille.replay.distances import estimates
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import read_recording
from robotouille_client.window.drawing.window_layout import Strip
from robotouille_client.window.options import DisplayOptions, WindowStyle
from robotouille_client.window.replay.timeline.steps_to_go import StepsKnown
from robotouille_client.window.replay.viewer import RecordingViewer
from robotouille_client.window.window import Window

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "replay.png"
TASK, SEED = "multi_agent/07@3", 5
NAMES = ("ada", "bob", "cem")
STEP_RATE, HASTE, AWAY = 4.0, 0.45, range(24, 34)
"""Steps per second, probability that a player acts, and the steps in which cem is away."""
SAYS = {6: (0, "I take the stove"), 19: (1, "the pot is free"), 37: (2, "I am back")}
THINKS = {11: 2, 22: 1, 40: 0}
"""Player who declares reasoning, by step."""
SLIPS = {9: 0, 16: 1, 29: 0, 43: 1}
"""Player who tries an invalid action, by step."""
EXPANSIONS = 500


def record() -> bytes:
    """Play the game and return its recording."""
    world = World(TASK)
    dice, planner = random.Random(SEED), AnytimePlanner(world)
    rules = Rules(
        clock=Clock.REALTIME, step_rate=STEP_RATE, absence=Absence.BOT, substitute="planner",
        max_steps=200,
    )  # fmt: skip
    episode, recorder = Episode(world, rules), Recorder(world, wall=lambda: 0.0)
    created = "2026-01-01T12:00:00Z"
    head = header(world.task, rules, episode="picture", seed=SEED, created=created)
    stream = recorder.begin(head)
    players = world.players
    bots = {p: PlannerPolicy(world, p, PlannerOptions(seed=SEED), anytime=planner) for p in players}
    for player, name in zip(players, NAMES, strict=True):
        episode.join(player, name, "human", 0.0)
    step, now = 0, 0.0
    while episode.outcome is None:
        step += 1
        _happens(episode, step, now)
        for place, (player, bot) in enumerate(bots.items()):
            action = bot.act(episode.state)
            away = place == 2 and step in AWAY
            if away:
                episode.substitute(player, action, now)
            elif not episode.state.busy_steps(player) and dice.random() < HASTE:
                thought = "next in the recipe" if THINKS.get(step) == place else ""
                episode.submit(player, ActionRequest(step, action, reasoning=thought), now)
        now += 1 / STEP_RATE
        episode.tick(now)
        stream += recorder.record(episode.events())
    return stream


def _happens(episode: Episode, step: int, now: float) -> None:
    """Apply absences, chat and invalid actions of a step."""
    players = episode.world.players
    if step in (AWAY.start, AWAY.stop):
        episode.set_present(players[2], step == AWAY.stop, now)
    if step in SAYS:
        place, words = SAYS[step]
        episode.say(NAMES[place], players[place], words, now)
    if step in SLIPS:
        player = players[SLIPS[step]]
        held = [a for a in episode.world.initial.actions(player) if a.name == "move"]
        wrong = next(a for a in held if a not in episode.state.actions(player))
        episode.submit(player, ActionRequest(step, wrong), now)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("output", type=Path, nargs="?", default=PICTURE, metavar="OUT.png")
    output = parser.parse_args(arguments).output
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "game.rbt"
        path.write_bytes(compress(record()))
        recordings = [(path, read_recording(path))]
        viewer = RecordingViewer(recordings, now=lambda: 0.0, make_window=_make_window)
        curve = viewer.strips[0].curve
        curve.begun = True
        for step, left in estimates(read_recording(path), EXPANSIONS, Deadline(600.0)):
            curve.add(step, StepsKnown(left.bound, left.steps, left.dead))
        viewer.state.log = True
        viewer.playhead.seek(viewer.playhead.length * 4 // 5, playing=False)
        viewer.window.frame(viewer)
        _point_at(viewer, next(mark for mark in viewer.histories[0].marks if mark.step > 27).step)
        viewer.window.screenshot(output)
        viewer.close()


def _make_window(caption: str, strip: Strip) -> Window:
    return Window(DisplayOptions(caption=caption, headless=True), style=WindowStyle(strip=strip))


def _point_at(viewer: RecordingViewer, step: int) -> None:
    """Move the mouse over a step of the first lane."""
    place = viewer.strips[0].place_of(step)
    moved = pygame.Event(pygame.MOUSEMOTION, pos=place, rel=(0, 0), buttons=(0, 0, 0))
    pygame.event.post(moved)
    viewer.window.frame(viewer)


if __name__ == "__main__":
    main()
