"""Server messages without a server, for tests of the client's state machines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robotouille import GroundAction, World, load_task
from robotouille.protocol import messages
from robotouille.protocol.states import StateWriter, unmet_rows

__all__ = ["ScriptedServer"]

EPISODE = "e1"
CODE = "KQXZB-MHTWA"


class ScriptedServer:
    """One episode and the messages about it."""

    def __init__(self, task: str = "multi_agent/02") -> None:
        self.world = World(load_task(task))
        self.state = self.world.initial
        self.step = 0
        self._writer = StateWriter(self.world)
        self._resumes = 0

    def welcome(self, *, resumed: bool = False) -> messages.Welcome:
        self._resumes += 1
        return messages.Welcome(
            protocol=1,
            server="x",
            session="s",
            resume=f"resume-{self._resumes}",
            resumed=resumed,
            role="host",
            grace=1.0,
        )

    def joined(
        self, ref: int | None = None, *, episode: str = EPISODE, **fields: Any
    ) -> messages.Joined:
        seat = {"role": "player", "seat": self.world.players[0], "step": self.step}
        return messages.Joined(ref=ref, episode=episode, code=CODE, **{**seat, **fields})

    def snapshot(self, **fields: Any) -> messages.Snapshot:
        state = self.state
        seats = [messages.SeatInfo(player=player) for player in self.world.players]
        plain = {
            "episode": EPISODE,
            "step": self.step,
            "phase": "running",
            "digest": self.world.task.digest,
            "task": self.world.task.json,
            "hash": self._writer.digest(state),
            "clock": {"clock": "lockstep"},
            "seats": seats,
            **self._writer.tables(state),
            **self._writer.values(state),
        }
        return messages.Snapshot(**{**plain, **fields})

    def delta(
        self, actions: Sequence[GroundAction | None] = (), *, seq: Sequence[int] = ()
    ) -> messages.Delta:
        """Advance one step with these actions and their sequence numbers, and return its delta."""
        before, self.step = self.state, self.step + 1
        step = before.step(list(actions))
        self.state = step.state
        did = [
            [self.world.players.index(a.action.player), a.action.name, *a.action.arguments]
            for a in step.attempts
        ]
        return messages.Delta(
            step=self.step,
            did=did,
            seq=list(seq) or [0] * len(did),
            unmet=unmet_rows(step.attempts),
            **self._writer.changes(before, self.state),
        )

    def observation(self, **fields: Any) -> messages.Observation:
        plain = {"episode": EPISODE, "step": self.step, "text": "a kitchen", "actions": ["Wait"]}
        return messages.Observation(**{**plain, **fields})

    def moved(self, ref: int | None = None, **fields: Any) -> messages.Moved:
        return messages.Moved(ref=ref, **{"episode": EPISODE, "port": 9000, **fields})

    def error(self, code: str, ref: int | None = None) -> messages.Error:
        return messages.Error(ref=ref, code=code, message="no")
