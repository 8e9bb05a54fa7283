"""Live history, and the viewer of a game that was just played on a server."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import pygame
import pytest
from tests.support.window_play import Timer

from robotouille import World
from robotouille.certification.certificate import load_certificate
from robotouille.domain.rendering import Language
from robotouille.episode.tallies import Activity
from robotouille.planning import read_plan
from robotouille.protocol.messages import SeatInfo
from robotouille.world.unmet import only_words
from robotouille.world.world import State
from robotouille_client.sansio.game_events import (
    ActRejected,
    Announced,
    ChatReceived,
    StateChanged,
)
from robotouille_client.window.replay import workers
from robotouille_client.window.replay.histories import live_history as live
from robotouille_client.window.replay.histories.history import EntryKind
from robotouille_client.window.replay.histories.live_history import LiveHistory
from robotouille_client.window.replay.histories.recorded_states import write_states
from robotouille_client.window.replay.timeline.steps_to_go import StepsKnown
from robotouille_client.window.replay.viewer import HistoryViewer

AREA = pygame.Rect(0, 300, 640, 60)


@dataclass
class Game:
    """The part of a game that a history uses."""

    world: World
    state: State
    step: int = 0
    turn: str | None = None
    outcome: dict[str, Any] | None = None

    @property
    def seats(self) -> tuple[SeatInfo, ...]:
        player = self.world.players[0]
        return (SeatInfo(player=player, name="ada", kind="human", controller="human"),)

    @property
    def clock(self) -> dict[str, Any]:
        return {"clock": "realtime", "step_rate": 4.0, "max_steps": 90}


@pytest.fixture
def history() -> LiveHistory:
    world = World("synchronous/01")
    return LiveHistory(Game(world, world.initial), lambda: 0.0)


def take(history: LiveHistory, steps: int) -> list[State]:
    """Take some steps in which the player walks. Return the states."""
    states = [history.state(history.length)]
    player = history.world.players[0]
    for _ in range(steps):
        action = next(a for a in states[-1].actions(player) if a.name == "move")
        states.append(states[-1].step(action).state)
        did = ((player, action, True),)
        history.observe(StateChanged(history.length + 1, states[-1], states[-2], did))
    return states


def test_a_long_game_drops_its_beginning(
    history: LiveHistory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MAX_STATES", 20)
    monkeypatch.setattr(live, "_FORGOTTEN_AT_ONCE", 5)
    states = take(history, 63)
    assert len(history._states) <= 25
    assert history.first > 30
    assert history.length == 63
    for step in range(history.first, 64):
        assert history.state(step) == states[step]
        assert history.entries(step)
    assert history.state(0) == history.state(history.first)
    assert not history.entries(3)


def test_large_states_are_dropped_sooner(
    history: LiveHistory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hostile server makes large states with small messages, and the window kept 20,000."""
    monkeypatch.setattr(live, "MAX_STATE_BYTES", 10_000)
    world = history.world
    pairs = product(*([t.name for t in world.placed if t.type == k] for k in ("item", "station")))
    rows = [("cook", 0, pair, (0, 1)) for pair in pairs]
    states = take(history, 40)
    for step in range(41, 60):
        states.append(
            world.restore(world.initial.facts, [*rows, ("fry", *rows[0][1:3], (0, step))])
        )
        history.observe(StateChanged(step, states[-1], states[-2]))
    kept = {id(history.state(step)) for step in range(60)}
    assert len(rows) * len(kept) < 100
    assert history.state(59) == states[59]
    assert history.first + len(kept) == 60


def test_missed_steps_share_the_memory_of_a_state(
    history: LiveHistory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MAX_STATE_BYTES", 10_000)
    states = take(history, 5)
    history.observe(StateChanged(205, states[0]))
    assert history.first == 0
    assert history.state(204) == states[5]
    monkeypatch.setattr(live, "MAX_STATES", 100)
    monkeypatch.setattr(live, "_FORGOTTEN_AT_ONCE", 100)
    take(history, 1)
    assert history.first == 100
    monkeypatch.setattr(live, "MAX_STATES", 1_000)
    take(history, 60)
    assert len({id(history.state(step)) for step in range(267)}) <= 25


def test_declared_waiting_is_not_idling(history: LiveHistory) -> None:
    (player,) = history.world.players
    state = history.world.initial
    for waits in ((player,), ()):
        history.observe(StateChanged(history.length + 1, state, state, (), waits=waits))
    assert [history.activity(player, step) for step in (1, 2)] == [Activity.WAITING, Activity.IDLE]


def test_own_rejections_keep_their_reasons(history: LiveHistory) -> None:
    world = history.world
    player = world.players[0]
    take(history, 2)
    far = next(a for a in world.initial.actions(player) if a.name == "move")
    unmet = only_words("the table is not free")
    history.observe(ActRejected(3, 2, str(far), unmet, "action/invalid", player))
    (entry,) = [e for e in history.entries(2) if e.kind is EntryKind.REJECTED]
    assert entry.player == player
    assert entry.reasons == ("the table is not free",)
    assert history.marks[-1].kind is EntryKind.REJECTED


def test_announcements_become_interludes(history: LiveHistory) -> None:
    take(history, 4)
    history.observe(Announced("lunch"))
    assert history.interludes == [(4, "The operator: lunch", True)]
    assert history.max_steps == 90


def test_the_log_uses_the_viewers_words(history: LiveHistory) -> None:
    kind = history.world.thing("table1").kind
    language = Language.model_validate({"kinds": {kind: "Tisch"}})
    own = LiveHistory(history._game, lambda: 0.0, language)
    take(own, 2)
    assert "Tisch" in str(own.entries(2))


def test_endless_texts_in_one_step_replace_older_ones(
    history: LiveHistory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MAX_CHARACTERS", 10_000)
    player = history.world.players[0]
    for number in range(300):
        history.observe(ChatReceived("ada", player, f"{number} {'x' * 400}"))
        history.observe(Announced(f"{number} {'x' * 400}"))
        history.observe(ActRejected(1, 0, f"{number} {'y' * 400}", only_words("no"), "", player))
    logged, said = history.entries(0), history.chat(0, 999)
    assert 9 <= len(logged) <= 20
    assert {entry.words[:4] for entry in logged[-3:]} == {"299 "}
    assert 6 <= len(said) <= 40
    assert 3 <= len(history.interludes) <= 20
    assert said[-1][1].startswith("299 ")


def test_long_texts_are_cut(history: LiveHistory) -> None:
    player = history.world.players[0]
    reasons = only_words(*["z" * 10_000] * 100)
    history.observe(ActRejected(1, 0, "y" * 10_000, reasons, "", player))
    history.observe(Announced("x" * 10_000))
    rejected, announced = history.entries(0)
    assert (len(rejected.words), len(announced.words)) == (500, 500)
    assert sum(map(len, rejected.reasons)) <= 16 * 500


# The viewer


def seen(missed: int = 0) -> LiveHistory:
    """Return the history of a shortest game, from the step `missed` on."""
    world = World("synchronous/01")
    plan = read_plan("\n".join(load_certificate(world.task).plan or ()), world)
    states = [world.initial]
    for joint in plan:
        states.append(world.step(states[-1], joint).state)
    game = Game(world, states[missed], missed)
    history = LiveHistory(game, lambda: 0.0)
    for step in range(missed + 1, len(states)):
        history.observe(StateChanged(step, states[step], states[step - 1], ()))
    return history


@pytest.fixture
def viewer(tmp_path: Path) -> Iterator[HistoryViewer]:
    viewer = HistoryViewer(seen(), Timer(), tmp_path / "videos" / "game")
    yield viewer
    viewer.close()


def press(viewer: HistoryViewer, key: int) -> None:
    event = pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode="")
    assert viewer.strip.handle(event, AREA)


def test_the_worker_counts_from_the_first_saved_step(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    history = seen(missed=3)
    write_states(history, tmp_path / "seen.states")
    assert workers.main("steps", str(tmp_path / "seen.states"), "200", "600") == 0
    steps = {int(line[1:].split(",")[0]) for line in capsys.readouterr().out.splitlines()}
    assert steps == set(range(3, history.length + 1))
    assert workers.main("steps", str(tmp_path / "none.states"), "200", "600") == 1


@pytest.mark.process
def test_steps_to_go_are_computed_in_the_background(viewer: HistoryViewer) -> None:
    press(viewer, pygame.K_g)
    assert viewer.strip.curve.known[0] == StepsKnown(8, 8)
    assert viewer.wait_for_search(120)
    viewer.view()
    assert len(viewer.strip.curve.known) == 9
    assert "every step" in viewer.state.message


@pytest.mark.slow
def test_a_clip_is_saved_while_the_window_goes_on(viewer: HistoryViewer, tmp_path: Path) -> None:
    pytest.importorskip("av")
    viewer.state.first, viewer.state.last = 2, 3
    press(viewer, pygame.K_v)
    while viewer.state.jobs:
        viewer.view()
    video = tmp_path / "videos" / "game-2-3.mp4"
    assert str(video) in viewer.state.message
    assert video.stat().st_size > 1000
    assert list(video.parent.iterdir()) == [video]


def test_a_stopped_video_leaves_nothing(viewer: HistoryViewer, tmp_path: Path) -> None:
    pytest.importorskip("av")
    for stop in (lambda: press(viewer, pygame.K_v), viewer.close):
        press(viewer, pygame.K_v)
        viewer.view()
        stop()
        viewer.view()
        assert not list((tmp_path / "videos").iterdir())
