"""Measure the processor time to open, seek and draw a long recording in the viewer.

python -m benchmarks.viewer [--steps 10000]
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from pathlib import Path

from tests.support.games import random_choice, record

from robotouille import World
from robotouille.episode import ActionRequest, Clock, Episode, Event, Phase, Rules
from robotouille.replay.compression import compress
from robotouille.replay.recording import read_recording
from robotouille_client.window.drawing.window_layout import Strip
from robotouille_client.window.options import DisplayOptions, WindowStyle
from robotouille_client.window.replay.viewer import RecordingViewer
from robotouille_client.window.window import Window

TASK = "multi_agent/07@4"
SIZE = (1280, 720)
SEEKS = 200


def long_recording(steps: int) -> bytes:
    """Return a recording of four players who act at random and never reach the goal."""
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
                episode.submit(player, ActionRequest(seq, choose(episode, player)), seq * 0.1)
        episode.tick(seq * 0.1)
        events += episode.events()
    return compress(record(episode, events))


def main(arguments: list[str] | None = None) -> None:
    """Print the results with their targets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.rbt"
        path.write_bytes(long_recording(options.steps))
        begun = time.process_time()
        recording = read_recording(path)
        read = time.process_time() - begun
        viewer = RecordingViewer([(path, recording)], make_window=_make_window)
        viewer.window.frame(viewer)
        opened = time.process_time() - begun
        begun = time.process_time()
        states = sum(1 for _ in read_recording(path).states())
        simulated = time.process_time() - begun
        viewer.playhead.toggle()
        seeks, frames = _seeks(viewer, recording.length)
        viewer.close()
    print("\nTargets: open in less than 1,000 ms, seek in less than 50 ms")
    print(f"Recording of {recording.length:,} steps, four players, {SIZE[0]} x {SIZE[1]}")
    print(f"  read and simulate             {simulated * 1000:8.1f} ms for {states:,} states")
    print(f"  read                          {read * 1000:8.1f} ms")
    print(f"  open, to the first frame      {opened * 1000:8.1f} ms, {opened / simulated:.2f} ×")
    print(f"  seek and draw                 {_words(seeks)}")
    print(f"  draw again without a seek     {_words(frames)}")


def _make_window(caption: str, strip: Strip) -> Window:
    return Window(DisplayOptions(SIZE, caption, headless=True), style=WindowStyle(strip=strip))


def _seeks(viewer: RecordingViewer, length: int) -> tuple[list[float], list[float]]:
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
