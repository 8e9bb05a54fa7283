"""Record of the messages that one client received, as evidence against the server."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille_client import ActResult, Game

__all__ = ["Witness", "rows_of"]

CHAT_EVERY = 11
"""Steps between two chat messages of a bot."""


class Witness:
    """Observer between a connection and its `Game` that writes one JSON line per message.

    `heard` is called with every message before the bot receives it. The bot does not notice the
    observer.
    """

    def __init__(
        self,
        game: Game,
        name: str,
        folder: Path,
        heard: Callable[[messages.ServerMessage], None] | None = None,
    ) -> None:
        self.game = game
        self.name = name
        self._heard = heard
        self._farewell = ""
        self._receive, self._submit = game.receive, game.submit
        path = folder / f"{game.episode}-{game.seat or 'eye'}-{name}.jsonl"
        self._file = path.open("w", encoding="utf-8")
        self._write("game", game.episode, game.seat, name)
        self._write("state", game.step, game.state.digest)
        game.receive = self.receive  # type: ignore[method-assign]
        game.submit = self.submit  # type: ignore[method-assign]

    def receive(self, message: messages.ServerMessage, now: float, size: int = 0) -> None:
        """Record a message as the server sent it, then the client's resulting state."""
        if self._heard is not None:
            self._heard(message)
        before = self.game.step
        self._receive(message, now, size)
        for row in rows_of(message):
            self._write(*row)
        match message:
            case messages.Delta() if self.game.step == message.step > before:
                self._write("state", message.step, self.game.state.digest)
                self._chat(message.step)
            case messages.Left() | messages.Bye():
                self._farewell = message.reason

    def _chat(self, step: int) -> None:
        if step % CHAT_EVERY == 1 and self.game.seat is not None:
            text = f"{self.name} at step {step}"
            self._write("says", text)
            self.game.say(text)

    def submit(
        self, action: Any, seat: str | None = None, **details: Any
    ) -> asyncio.Future[ActResult]:
        """Submit an action and record its result."""
        future = self._submit(action, seat, **details)
        named = [action.name, *action.arguments] if isinstance(action, GroundAction) else None
        future.add_done_callback(partial(self._answered, self.game._sent.seq, named))
        return future

    def _answered(
        self, seq: int, action: list[str] | None, done: asyncio.Future[ActResult]
    ) -> None:
        if not done.cancelled():
            result = done.result()
            self._write("act", seq, action, result.applied, result.step, result.code)

    async def close(self) -> None:
        """Record how the episode ended for this client."""
        await asyncio.sleep(0)
        outcome = self.game.outcome
        why = f"the client received no outcome: {self._farewell or 'no reason'}"
        self._write("over", outcome, "" if outcome else why)
        self._file.close()

    def _write(self, *row: Any) -> None:
        if not self._file.closed:
            self._file.write(json.dumps(row, separators=(",", ":")) + "\n")


def rows_of(message: messages.ServerMessage) -> list[list[Any]]:
    """Return what a message reveals about an episode, as rows of the evidence."""
    match message:
        case messages.Delta():
            unmet = sorted(int(row) for row in message.unmet)
            return [["delta", message.step, message.did, message.seq, unmet]]
        case messages.Snapshot() | messages.Ended():
            return [["state", message.step, message.hash]]
        case messages.Said():
            return [["said", message.number, message.name, message.seat, message.text]]
    return []
