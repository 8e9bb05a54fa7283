"""Declared waits count as waiting, not as idle."""

from __future__ import annotations

import json
from dataclasses import asdict

from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.replay.controllers import json_lines
from robotouille.replay.measures import activities
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from tests.support.episodes import TWO, first

RULES = Rules(clock=Clock.LOCKSTEP, max_steps=3)


def played() -> tuple[Episode, bytes]:
    """Play: the first seat waits, idles and acts; the second one idles, waits and idles."""
    recorder = Recorder(TWO)
    episode = Episode(TWO, RULES)
    content = recorder.begin(header(TWO.task, RULES, episode="e"))
    for player in ("robot1", "robot2"):
        episode.join(player, player, "bot", 0.0, session=player)
    for seq, waits in enumerate(((True, False), (False, True), (True, False)), 1):
        action = first(episode, "robot1") if seq == 3 else None
        episode.submit("robot1", ActionRequest(seq, action, waits=waits[0]), float(seq))
        episode.submit("robot2", ActionRequest(seq, waits=waits[1]), float(seq))
    return episode, content + recorder.record(episode.events())


def test_wait_is_counted_as_waiting() -> None:
    episode, _ = played()
    assert episode.outcome is not None
    one, two = (asdict(tally) for tally in episode.outcome.seats)
    assert (one["waiting"], one["idle"], one["acted"], one["rejected"]) == (1, 1, 1, 0)
    assert (two["waiting"], two["idle"], two["acted"], two["rejected"]) == (1, 2, 0, 0)


def test_wait_is_recorded() -> None:
    recording = Recording(played()[1], "test")
    assert [frame.get("waits") for frame in recording.steps] == [["robot1"], ["robot2"], None]
    received = [tuple(seats.did.values()) for _, seats in activities(recording)]
    assert received == [("waiting", "idle"), ("idle", "waiting"), ("acted", "idle")]
    lines = [json.loads(line) for line in json_lines(recording)]
    exported = [line["waits"] for line in lines if line["kind"] == "step"]
    assert exported == [["robot1"], ["robot2"], []]
    assert recording.verify().ok
