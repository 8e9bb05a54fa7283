"""Record of the frames that one person's pages send and receive, as evidence like a `Witness`'s."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robotouille.protocol import messages
from robotouille.protocol.codec import JSON
from tests.programs.drill.accidents import ENTERING
from tests.programs.drill.witness import rows_of

__all__ = ["PageWitness"]

CHOICE_SECONDS = 0.7
"""Time after a choice in which a page sends its action."""


class PageWitness:
    """Observer of all connections of a person's pages, on any device.

    It sees what goes over the network, so its rows do not depend on what the page makes of it.
    An action whose page was closed before the answer came has no row: its person cannot know.

    Args:
        said: Receives `back` and `lost` when the person's seat has a connection and loses it, and
            `phase` with each new phase.

    Attributes:
        phase: The phase of the episode as the person knows it; see `accidents.PHASES`.
        sent: Number of different actions that the pages have sent.
    """

    def __init__(
        self, episode: str, seat: str, name: str, folder: Path, said: Callable[..., None]
    ) -> None:
        self.episode = episode
        self.phase = ENTERING
        self.here = False
        self.outcome: dict[str, Any] = {}
        self.faults: list[str] = []
        self.sent = 0
        self.step = 0
        self._seat, self._said = seat, said
        self._index = -1
        self._socket: Any = None
        self._open: dict[int, list[str] | None] = {}
        self._last_seq = 0
        self._chose_at = 0.0
        self._waits_since: float | None = None
        path = folder / f"{episode}-{seat}-{name}.jsonl"
        self._file = path.open("w", encoding="utf-8")
        self._write("game", episode, seat, name)

    def follow(self, page: Any) -> None:
        """Observe the connections of a page from now on."""
        page.on("websocket", self._opened)

    def forget(self) -> None:
        """Forget the unanswered action of a page that is closed."""
        self._open.clear()
        self._last_seq = 0
        self._waits_since = None

    @property
    def unanswered_seconds(self) -> float:
        """Time for which an action has had no answer although the game went on."""
        if not self._open or self._waits_since is None:
            return 0.0
        return time.monotonic() - self._waits_since

    @property
    def unanswered(self) -> bool:
        """True if the last action has no answer."""
        return bool(self._open)

    def close(self) -> None:
        """Record how the episode ended for this person."""
        why = "" if self.outcome else "the pages received no outcome"
        self._write("over", self.outcome, why)
        self._file.close()

    # Connections

    def _opened(self, socket: Any) -> None:
        self._socket = socket
        socket.on("framereceived", lambda data: self._received(socket, data))
        socket.on("framesent", lambda data: self._sends(socket, data))
        socket.on("close", lambda _: self._lost(socket))

    def _lost(self, socket: Any) -> None:
        if socket is not self._socket:
            return
        self._socket = None
        self._go_on()
        if self.here:
            self.here = False
            self._said("lost")

    def _sends(self, socket: Any, data: str | bytes) -> None:
        message = json.loads(data)
        if message["type"] == "say":
            self._write("says", message["text"])
        elif message["type"] == "act":
            seq, action = message["seq"], message["action"]
            if seq <= self._last_seq and seq not in self._open:
                self.faults.append(f"the page sent action {seq} again, which had an answer")
            if seq > self._last_seq:
                self.sent += 1
                self._check_choice(seq)
            self._last_seq = max(self._last_seq, seq)
            self._open[seq] = [action["name"], *action["args"]] if action else None
            self._go_on()

    def chose(self) -> None:
        """Note that the person has just chosen an action."""
        self._chose_at = time.monotonic()

    def _check_choice(self, seq: int) -> None:
        """Note a fault if a page replaces an unanswered action by itself: both may be done."""
        if self._open and time.monotonic() - self._chose_at > CHOICE_SECONDS:
            waiting = max(self._open)
            self.faults.append(f"action {seq} without a choice, and action {waiting} has no answer")

    def _received(self, socket: Any, data: str | bytes) -> None:
        if socket is not self._socket:
            return
        message = JSON.decode_server(data)
        for row in rows_of(message):
            self._write(*row)
        match message:
            case messages.Welcome() if not message.resumed:
                # The page's session is new: it does not repeat an action of the last one.
                self.forget()
            case messages.Joined():
                self._last_seq = max(self._last_seq, message.seq)
                self._joins()
            case messages.Snapshot():
                self._snapshot(message)
            case messages.Delta():
                self._delta(message)
            case messages.Rejected() if message.code != "rate/limited":
                self._answer(message.seq, False, message.step, message.code)
            case messages.Roster():
                self._roster(message)
            case messages.Ended():
                self.outcome = dict(message.outcome)
                self._enter("ended")
                self.forget()

    def _joins(self) -> None:
        self._go_on()
        if not self.here:
            self.here = True
            self._said("back")

    # Messages

    def _snapshot(self, message: messages.Snapshot) -> None:
        if message.task is not None:
            self._index = [seat.player for seat in message.seats].index(self._seat)
        self.step = message.step
        self._roster(message)
        if message.outcome is not None:
            self.outcome = dict(message.outcome)
            self._enter("ended")
        if message.last_seq in self._open:
            applied = not message.last_reasons
            self._answer(message.last_seq, applied, message.last_step, "")
        # The snapshot does not reveal what became of earlier actions.
        for seq in [seq for seq in self._open if seq <= message.seq]:
            del self._open[seq]

    def _delta(self, message: messages.Delta) -> None:
        if message.step <= self.step:
            return
        self.step = message.step
        if message.hash is not None:
            self._write("state", message.step, message.hash)
        for number, (row, seq) in enumerate(zip(message.did, message.seq, strict=True)):
            if row[0] != self._index or not seq:
                continue
            for earlier in sorted(each for each in self._open if each < seq):
                self._answer(earlier, False, message.step, "superseded")
            self._answer(seq, str(number) not in message.unmet, message.step, "")

    def _roster(self, message: messages.Roster | messages.Snapshot) -> None:
        counts_down = message.phase == "waiting" and message.starts_in is not None
        self._enter("countdown" if counts_down else str(message.phase))

    def _enter(self, phase: str) -> None:
        if phase != self.phase:
            self.phase = phase
            self._said("phase", phase=phase)
            self._go_on()

    def _answer(self, seq: int, applied: bool, step: int, code: str) -> None:
        if seq in self._open:
            self._write("act", seq, self._open.pop(seq), applied, step, code)

    def _go_on(self) -> None:
        """Note from when on the server can answer."""
        can = self._socket is not None and self.phase == "running"
        self._waits_since = time.monotonic() if can else None

    def _write(self, *row: Any) -> None:
        if not self._file.closed:
            self._file.write(json.dumps(row, separators=(",", ":")) + "\n")
