"""Golden pictures of the replay viewer with an eventful episode and all pages open."""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import pygame

from robotouille import GroundAction, State, World
from robotouille.episode import Absence, ActionRequest, Clock, Episode, Event, PauseReason, Rules
from robotouille.replay.recording import Recording
from robotouille_client.window.replay.timeline.steps_to_go import StepsKnown
from robotouille_client.window.replay.viewer import RecordingViewer
from robotouille_client.window.replay.viewer_state import JobProgress
from tests.support.games import record
from tests.support.window_play import headless_window

__all__ = ["VIEWER_SIZES", "eventful", "viewer_picture"]

STEPS = 40
VIEWER_SIZES = ((1120, 630), (320, 240))
MAX_WIDTH = 560
"""Largest width of a stored picture in pixels, because the files are in the repository."""


def eventful(steps: int = STEPS, task: str = "multi_agent/01") -> bytes:
    """Record an episode at two steps a second. bob is away in steps 3 to 6, ada chats after step 8,
    an action is rejected after step 10, step 12 has a reasoning, and step 20 pauses.
    """
    world = World(task)
    rules = Rules(
        clock=Clock.REALTIME,
        step_rate=2.0,
        absence=Absence.BOT,
        substitute="random",
        max_steps=steps,
    )
    episode = Episode(world, rules)
    events: list[Event] = []
    episode.join("robot1", "ada", "human", 0.0)
    episode.join("robot2", "bob", "human", 0.0)
    late = 0.0
    for step in range(steps):
        now = step / 2 + late
        if step == 2:
            episode.set_present("robot2", False, now)
        if step == 6:
            episode.set_present("robot2", True, now)
        if step == 8:
            episode.say("ada", "robot1", "the bun is yours", now)
        if step == 10:
            episode.submit("robot1", ActionRequest(step, _move(world.initial, 0)), now)
        elif step % 3 == 0:
            thought = "this first" if step == 12 else ""
            # Leave the first place, so that the move from there is rejected in step 10.
            action = _move(episode.state, step % 2)
            episode.submit("robot1", ActionRequest(step, action, reasoning=thought), now)
        if step == 20:
            episode.pause(PauseReason.OPERATOR, now)
            episode.announce("lunch", now)
            late = 7.0
            now += late
            episode.resume(PauseReason.OPERATOR, now)
        episode.tick(now + 0.5)
        events += episode.events()
    return record(episode, events)


def _move(state: State, number: int) -> GroundAction:
    return [a for a in state.actions("robot1") if a.name == "move"][number]


def viewer_picture(size: tuple[int, int]) -> pygame.Surface:
    """Draw the viewer with its log, a followed seat, a marked clip, the remaining steps, and a
    running job.
    """
    with tempfile.TemporaryDirectory() as folder:
        recording = Recording(eventful())
        path = Path(folder) / "eventful.rbt"
        make = partial(headless_window, size)
        viewer = RecordingViewer([(path, recording)], now=lambda: 0.0, make_window=make)
        state, curve = viewer.state, viewer.strips[0].curve
        state.log, state.first, state.last = True, 5, 30
        state.followed = "robot2"
        state.jobs["steps"] = JobProgress("Steps to go: 4 of 41", lambda: None, 0.3)
        curve.begun = True
        for step, least, most in ((0, 14, 14), (10, 12, 16), (20, 8, 13), (40, 5, 6)):
            curve.add(step, StepsKnown(least, most))
        viewer.playhead.seek(34, playing=False)
        viewer.window.frame(viewer)
        viewer.window.screenshot(Path(folder) / "shown.png")
        viewer.close()
        shown = pygame.image.load(Path(folder) / "shown.png")
    return pygame.transform.smoothscale_by(shown, min(1.0, MAX_WIDTH / size[0]))
