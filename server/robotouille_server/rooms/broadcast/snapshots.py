"""Snapshots of an episode: what is the same for all who get one is encoded once a step."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any
from weakref import WeakKeyDictionary

from robotouille.episode import ActionAnswer, Episode
from robotouille.protocol import messages
from robotouille.protocol.codec import Codec, Fields
from robotouille.protocol.states import StateWriter
from robotouille.world.world import State, World
from robotouille_server.transport import frame_of

__all__ = ["Snapshots", "last_seq", "own_answers"]

_tasks: WeakKeyDictionary[World, dict[Codec, Fields]] = WeakKeyDictionary()
"""Tasks as fields of a snapshot: the longest part, the same in all episodes of a task."""


class Snapshots:
    """Makes the frames of `snapshot` messages."""

    __slots__ = ("_episode", "_id", "_packed", "_state", "_step", "_writer")

    def __init__(self, episode_id: str, episode: Episode, writer: StateWriter) -> None:
        self._id = episode_id
        self._episode = episode
        self._writer = writer
        self._state: State | None = None
        self._step = 0
        self._packed: dict[Codec, Fields] = {}

    def frame(self, codec: Codec, own: dict[str, Any], *, with_task: bool) -> bytes:
        """A snapshot of the present state; `own` are the fields that others have not, or have
        with other values."""
        parts = [self._of_state(codec), codec.pack_fields(own)]
        if with_task:
            parts.append(self._of_task(codec))
        return frame_of(codec.join(parts))

    def forget(self) -> None:
        """The state is another."""
        self._state = None
        self._packed.clear()

    def _of_state(self, codec: Codec) -> Fields:
        episode = self._episode
        if self._state is not episode.state or self._step != episode.step:
            self.forget()
            self._state, self._step = episode.state, episode.step
        fields = self._packed.get(codec)
        if fields is None:
            state = episode.state
            fields = self._packed[codec] = codec.pack_fields(
                {
                    "type": "snapshot",
                    "episode": self._id,
                    "step": episode.step,
                    "digest": episode.world.task.digest,
                    "hash": self._writer.digest(state),
                    "clock": episode.rules.model_dump(mode="json"),
                    **self._writer.tables(state),
                    **self._writer.values(state),
                }
            )
        return fields

    def _of_task(self, codec: Codec) -> Fields:
        world = self._episode.world
        packed = _tasks.setdefault(world, {})
        if codec not in packed:
            packed[codec] = codec.pack_fields({"task": world.task.json})
        return packed[codec]


def last_seq(episode: Episode, players: Collection[str]) -> int:
    """The highest sequence number of an action that these players' seats have sent."""
    return max((episode.seats[player].seq for player in players), default=0)


def own_answers(episode: Episode, players: Collection[str]) -> dict[str, Any]:
    """The fields that tell a participant what became of the last action of each of its seats."""
    answers = [_answer_row(player, episode.seats[player].answer) for player in players]
    first = answers[0] if answers else {}
    return {
        "seat": first.get("seat"),
        "seq": last_seq(episode, players),
        "last_seq": first.get("seq", 0),
        "last_step": first.get("step", 0),
        "last_reasons": first.get("reasons", []),
        "answers": answers[1:],
    }


def _answer_row(player: str, answer: ActionAnswer) -> dict[str, Any]:
    seat_answer = messages.SeatAnswer(
        seat=player, seq=answer.seq, step=answer.step, reasons=list(answer.reasons)
    )
    return seat_answer.model_dump(mode="json", exclude_defaults=True)
