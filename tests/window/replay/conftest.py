"""A recording with something of everything in it, and a viewer without a screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests.support.games import record

from robotouille import GroundAction, State, World
from robotouille.episode import Absence, Clock, Episode, Event, PauseReason, Rules
from robotouille.replay.container import compress
from robotouille.replay.recording import Recording, read_recording
from robotouille_client.window.replay.viewer import Viewer

STEPS = 40


class Timer:
    """A clock that stands still."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def eventful(steps: int = STEPS, task: str = "multi_agent/01") -> bytes:
    """Two steps a second: bob is away in the steps 3 to 6, something is said after step 8, refused
    after step 10, thought in step 12, and the operator pauses after step 20."""
    world = World(task)
    rules = Rules(
        clock=Clock.REALTIME, step_rate=2.0, absence=Absence.BOT, stand_in="random", max_steps=steps
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
            episode.submit("robot1", step, _move(world.initial, 0), now)
        elif step % 3 == 0:
            thought = "this first" if step == 12 else ""
            # Away from where it began, so that the move from there is refused in step 10.
            action = _move(episode.state, step % 2)
            episode.submit("robot1", step, action, now, reasoning=thought)
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


@pytest.fixture(scope="session")
def stream() -> bytes:
    return eventful()


@pytest.fixture(scope="session")
def recording(stream: bytes) -> Recording:
    return Recording(stream)


@pytest.fixture
def path(stream: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "eventful.rbt"
    path.write_bytes(compress(stream))
    return path


@pytest.fixture
def opened() -> Iterator[Callable[..., Viewer]]:
    """Opens viewers of files, whose `timer` is a clock that stands still."""
    viewers: list[Viewer] = []

    def open_viewer(*paths: Path, size: tuple[int, int] = (1280, 720)) -> Viewer:
        timer = Timer()
        recordings = [(path, read_recording(path, damaged=True)) for path in paths]
        viewer = Viewer(recordings, size=size, headless=True, now=timer)
        viewer.timer = timer
        viewers.append(viewer)
        viewer.window.frame(viewer)
        return viewer

    yield open_viewer
    for viewer in viewers:
        viewer.close()
