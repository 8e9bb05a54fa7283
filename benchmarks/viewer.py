"""A long recording in the viewer: what opening, going anywhere and drawing cost, in time of a core.

python -m benchmarks.viewer [--steps 10000]
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from functools import partial
from pathlib import Path

from tests.support.games import random_choice, record

from robotouille import World
from robotouille.episode import Clock, Episode, Event, Phase, Rules
from robotouille.replay.container import compress
from robotouille.replay.recording import read_recording
from robotouille_client.window.replay.viewer import Viewer
from robotouille_client.window.window import Window

TASK = "multi_agent/07@4"
SIZE = (1280, 720)
SEEKS = 200


def long_recording(steps: int) -> bytes:
    """Four players who act at random, and never reach the goal."""
    world = World(TASK)
    rules = Rules(clock=Clock.LOCKSTEP, max_steps=steps)
    episode, choose = Episode(world, rules), random_choice(1)
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    events: list[Event] = []
    seq = 0
    while episode.phase is Phase.RUNNING:
        seq += 1
        for player in world.players:
            if episode.phase is Phase.RUNNING and not episode.state.busy_steps(player):
                episode.submit(player, seq, choose(episode, player), seq * 0.1)
        episode.tick(seq * 0.1)
        events += episode.events()
    return compress(record(episode, events))


def main(arguments: list[str] | None = None) -> None:
    """Print the figures, each beside what it is compared with."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.rbt"
        path.write_bytes(long_recording(options.steps))
        begun = time.process_time()
        recording = read_recording(path)
        read = time.process_time() - begun
        viewer = Viewer([(path, recording)], make_window=partial(Window, SIZE, headless=True))
        viewer.window.frame(viewer)
        opened = time.process_time() - begun
        begun = time.process_time()
        states = sum(1 for _ in read_recording(path).states())
        simulated = time.process_time() - begun
        viewer.playhead.toggle()
        seeks, frames = _seeks(viewer, recording.length)
        viewer.close()
    print("\nWanted: open in under 1,000 ms, go anywhere in under 50 ms")
    print(f"A recording of {recording.length:,} steps, four players, {SIZE[0]} x {SIZE[1]}")
    print(f"  read and simulate all of it   {simulated * 1000:8.1f} ms for {states:,} states")
    print(f"  only read it                  {read * 1000:8.1f} ms")
    print(
        f"  open it, to the first picture {opened * 1000:8.1f} ms, {opened / simulated:.2f} times"
    )
    print(f"  go anywhere, and draw         {_words(seeks)}")
    print(f"  draw again where one is       {_words(frames)}")


def _seeks(viewer: Viewer, length: int) -> tuple[list[float], list[float]]:
    generator = random.Random(2)
    seeks: list[float] = []
    frames: list[float] = []
    for _ in range(SEEKS):
        for times, goes in ((seeks, True), (frames, False)):
            begun = time.process_time()
            if goes:
                viewer.playhead.seek(generator.randint(0, length), playing=False)
            viewer.window.frame(viewer)
            times.append(time.process_time() - begun)
    return sorted(seeks), sorted(frames)


def _words(times: list[float]) -> str:
    middle, late = times[len(times) // 2], times[len(times) * 99 // 100]
    return f"{middle * 1000:8.1f} ms, 99 % under {late * 1000:.1f} ms"


if __name__ == "__main__":
    main()
