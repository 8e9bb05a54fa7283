"""Gestures of players: hops, raised arms, glances, shut eyes.

Nothing here reads a clock: the time comes with the view. Without a time, as in still pictures,
players move only with the steps of the game.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.animation import BEATS, StepAnimation
from robotouille_client.window.drawing.kitchen.spots import Pose
from robotouille_client.window.view import Bubble, View

Arms = Literal["down", "out", "up"]

STRIDES = 4
"""Footsteps of a player on each tile."""
CHEER_SECONDS = 2.2
"""Duration of the cheering or the disappointment after the end of a game."""
PRAISE_SECONDS = 0.8
"""Duration of the joy about a served dish."""

# Heights of hops in tiles: of a step, of work, of a signal, of joy.
_STEP, _EFFORT, _WAVE, _JOY = 0.06, 0.03, 0.07, 0.13
# Jumps of joy in a second.
_JUMPS = 2.4
# A breath: its seconds, and its heights in tiles. Few heights need few pictures.
_BREATH, _BREATHS = 2.6, (0.0, 0.008, 0.016)
# Seconds for which eyes are shut, and between two times; each player has a rhythm of its own.
_BLINK, _AWAKE = 0.13, 3.1
# Seconds between two pictures of calm players in real time.
_CALM = 0.2
# Seconds of a shaken head, of a hop with a signal, and of a glance at a speaker.
_SHAKE, _HOP, _GLANCE = 0.5, 0.35, 1.3
# Width of a shaken head in tiles, and its turns in a second.
_SHAKEN, _TURNS = 0.04, 6.0


@dataclass(frozen=True, slots=True)
class Gesture:
    """Posture of a player at one moment.

    Attributes:
        lift: Height above the ground, in tiles.
        lean: Shift to the right, in tiles.
        squash: 1 for a squat player, -1 for a stretched one, else 0.
        stride: Number of the picture of its feet.
    """

    facing: str
    arms: Arms = "down"
    lift: float = 0.0
    lean: float = 0.0
    squash: int = 0
    shut: bool = False
    stride: int = 0


class Gestures:
    """Computes gestures, and remembers since when each bubble is shown.

    Args:
        still: True if players move only from place to place, and hold still otherwise.
    """

    def __init__(self, *, still: bool = False) -> None:
        self._still = still
        self._shown: dict[Bubble, float] = {}
        self._served: tuple[int, float] | None = None

    def of(
        self, view: View, poses: dict[str, Pose], animation: StepAnimation, held: set[str]
    ) -> dict[str, Gesture]:
        """Return the gesture of each player. `held` are the players with something in hand."""
        self._remember(view)
        found = {}
        for name, gesture in self._all(view, poses, animation):
            found[name] = gesture
            if name in held:
                # The picture shows held objects on the side to which the player looks.
                found[name] = replace(gesture, arms="out", facing=poses[name].facing)
        return found

    def _all(
        self, view: View, poses: dict[str, Pose], animation: StepAnimation
    ) -> Iterator[tuple[str, Gesture]]:
        frozen = view.seconds is None or view.pause is not None or view.offline is not None
        for number, (name, pose) in enumerate(poses.items()):
            if self._still:
                yield name, Gesture(pose.facing, "out" if name in animation.working else "down")
            elif pose.walking:
                yield name, _walk(pose)
            elif name in animation.working:
                yield name, _work(pose, view.phase)
            elif frozen or view.seconds is None:
                yield name, Gesture(pose.facing)
            elif view.since_end is not None and view.since_end < CHEER_SECONDS:
                yield name, _at_the_end(pose, view, view.since_end, number)
            elif self._praised(view.seconds):
                joy = _jump(view.seconds + number / 3)
                # The direction of the local player says what its keys do.
                yield (
                    name,
                    joy if name != view.me else replace(joy, facing=pose.facing, arms="down"),
                )
            else:
                yield name, self._idle(view, poses, name, number)

    def _remember(self, view: View) -> None:
        if view.seconds is None:
            return
        self._shown = {b: self._shown.get(b, view.seconds) for b in view.bubbles}
        before = view.previous or view.state
        served, earlier = _served(view.state), _served(before)
        if served > earlier and (self._served is None or self._served[0] != served):
            self._served = served, view.seconds

    def _praised(self, seconds: float) -> bool:
        return self._served is not None and 0 <= seconds - self._served[1] < PRAISE_SECONDS

    def _idle(self, view: View, poses: dict[str, Pose], name: str, number: int) -> Gesture:
        """Return the gesture of a player that stands: it breathes, blinks, looks and reacts."""
        seconds, calm_at = view.seconds or 0.0, _calm_time(view)
        level = (1 + math.sin(math.tau * calm_at / _BREATH + math.pi * number)) / 2
        calm = Gesture(
            self._glance(view, poses, name),
            lift=_BREATHS[round(level * (len(_BREATHS) - 1))],
            shut=(calm_at + 1.7 * number) % (_AWAKE + 0.7 * number) < _blink(view),
        )
        for bubble, since in self._shown.items():
            age = seconds - since
            if bubble.player != name:
                continue
            if bubble.kind == "rejected" and age < _SHAKE:
                fading = 1 - age / _SHAKE
                return replace(calm, lean=_SHAKEN * fading * math.sin(math.tau * _TURNS * age))
            if (bubble.target or bubble.things) and age < _HOP:
                return replace(calm, lift=_WAVE * math.sin(math.pi * age / _HOP))
        return calm

    def _glance(self, view: View, poses: dict[str, Pose], name: str) -> str:
        """Return where a player looks: at the teammate who has just spoken, or straight ahead."""
        pose = poses[name]
        for bubble, since in self._shown.items():
            speaker, recent = poses.get(bubble.player), (view.seconds or 0.0) - since < _GLANCE
            if name == view.me or speaker is None or bubble.kind != "chat" or not recent:
                continue
            dx, dy = speaker.at[0] - pose.at[0], speaker.at[1] - pose.at[1]
            # From the side, the viewer sees the face of a player.
            if bubble.player != name and 2 * abs(dx) > abs(dy):
                return "right" if dx > 0 else "left"
            if bubble.player != name:
                return "back" if dy > 0 else "front"
        return pose.facing


def _calm_time(view: View) -> float:
    """Return the time at which players last breathed or blinked.

    In real time this happens with the steps, for which the window is drawn anyway. Pictures at
    other times would cost more than half as much again.
    """
    seconds, step = view.seconds or 0.0, view.step_seconds
    if step is None:
        return seconds
    parts = _parts(step)
    return seconds - (view.phase - int(view.phase * parts) / parts) * step


def _blink(view: View) -> float:
    """Return the time for which eyes are shut: at least as long as one picture is shown."""
    step = view.step_seconds
    return _BLINK if step is None else max(_BLINK, step / _parts(step))


def _parts(step: float) -> int:
    """Return the number of pictures of calm players in a step."""
    return max(1, round(step / _CALM))


def _served(state: State) -> int:
    return 0 if state.orders is None else state.orders.served


def _walk(pose: Pose) -> Gesture:
    wave = abs(math.sin(math.pi * STRIDES / 2 * pose.stride))
    squash = -1 if wave > 0.7 else 1 if wave < 0.25 else 0
    return Gesture(pose.facing, lift=_STEP * wave, squash=squash, stride=int(pose.stride * STRIDES))


def _work(pose: Pose, phase: float) -> Gesture:
    """Return the gesture of work: the player turns to the viewer, and its arms go up and down."""
    wave = math.sin(math.tau * BEATS * phase)
    behind = pose.facing == "back"
    raised: Arms = "up" if behind else "out"
    return Gesture(
        "front" if behind else pose.facing, raised if wave > 0 else "down", _EFFORT * abs(wave)
    )


def _at_the_end(pose: Pose, view: View, since: float, number: int) -> Gesture:
    if view.won:
        return _jump(since + number / 3)
    return Gesture(pose.facing, squash=1, shut=True) if view.lost else Gesture(pose.facing)


def _jump(seconds: float) -> Gesture:
    wave = abs(math.sin(math.pi * _JUMPS * seconds))
    return Gesture("front", "up", _JOY * wave, squash=-1 if wave > 0.8 else 1 if wave < 0.2 else 0)
