"""Copy of another node's episode, from the updates that its owner publishes for spectators."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Container
from typing import Any, Protocol

import msgpack

from robotouille.episode import Phase
from robotouille.protocol import messages
from robotouille.protocol.codec import MSGPACK
from robotouille_server.cluster.spectators.packets import PacketReader, split
from robotouille_server.rooms.publishing.audience import (
    MAX_STEP_BYTES,
    MAX_STEPS,
    SharedMessage,
    SharedStep,
)
from robotouille_server.rooms.publishing.broadcaster import KEPT_NOTICES, KEPT_SAID
from robotouille_server.runtime.logs import get_logger

STATE_SECONDS = 1.0
"""Seconds for which a snapshot, with the steps after it, is good for new spectators."""


class KeptState:
    """The last snapshot and all steps since, for spectators who need a state."""

    def __init__(self, fields: dict[str, Any], frame: bytes, task: Any, at: float) -> None:
        self.digest = str(fields["digest"])
        self.fields = fields
        self.steps: list[SharedStep] = []
        self._bytes = 0
        self._at = at
        self._plain = SharedMessage(fields, MSGPACK, frame)
        self._whole = SharedMessage({**fields, "task": task})

    def add(self, step: SharedStep) -> None:
        self.steps.append(step)
        self._bytes += len(step.frame(MSGPACK))

    def good(self, now: float) -> bool:
        """Return whether it is new and short enough."""
        short = len(self.steps) <= MAX_STEPS and self._bytes <= MAX_STEP_BYTES
        return short and now - self._at <= STATE_SECONDS

    def messages(self, *, known: bool) -> list[SharedMessage]:
        """Return the snapshot and the steps; `known` if the client has the task."""
        return [self._plain if known else self._whole, *self.steps]


class KeptChat:
    """The last chat messages.

    Messages after a missing one are held back, because clients ignore those that come too late.

    Attributes:
        complete_to: The number of the last message before the first missing one.
        last: The number of the last message.
    """

    def __init__(self) -> None:
        self.complete_to = self.last = 0
        self._begin = 0
        self._answered = False
        self._lines: dict[int, messages.Said] = {}

    def begin_after(self, number: int) -> None:
        """Note that nobody here needs messages up to a number, except those who come back."""
        self._begin = number
        self.last = max(self.last, number)

    @property
    def incomplete(self) -> bool:
        return self.complete_to < self.last

    def answered_after(self, number: int) -> None:
        """Note that the next messages are all that the owner still has after a number."""
        self._answered = number <= self.complete_to

    def complete(self, count: int) -> list[messages.Said]:
        """Note the number of messages in a snapshot, which the owner sends after all of them.

        Returns:
            The messages that can be shown now.
        """
        self.last = max(self.last, count)
        answered, self._answered = self._answered, False
        return self._show_to(count) if answered else []

    def add(self, said: messages.Said) -> list[messages.Said]:
        """Keep a message; return the messages that can be shown now."""
        if said.number <= self.complete_to:
            return []
        self._lines[said.number] = said
        while len(self._lines) > KEPT_SAID:
            del self._lines[min(self._lines)]
        self.last = max(self.last, said.number)
        end = self.complete_to
        while end + 1 in self._lines:
            end += 1
        return self._show_to(end)

    def _show_to(self, end: int) -> list[messages.Said]:
        begin = max(self._begin, self.complete_to)
        self.complete_to = max(self.complete_to, end)
        return [said for said in self.after(begin) if said.number <= end]

    def after(self, number: int) -> list[messages.Said]:
        """Return the complete messages after a number, in order."""
        lines = sorted(self._lines.items())
        return [said for key, said in lines if number < key <= self.complete_to]


class CaughtUp(Protocol):
    """Function that is called with each snapshot; `jumped` if all spectators need it."""

    def __call__(self, *, jumped: bool) -> None: ...


class Updates:
    """Copy of another node's episode, as far as spectators receive it.

    Args:
        add: Called with each message for all spectators.
        caught_up: Called after each snapshot.
        lack: Called when updates are missing.

    Attributes:
        step: The last step.
        phase: The phase.
        task: The task, once it is known.
        seats: The seats, as the last roster shows them.
        chat: The last chat messages.
        notices: The last announcements, and their times.
        packets: Reads what relays publish.
        lost: True from a gap until the next snapshot, which all spectators then receive.
        limits_sight: True if players see a part of the kitchen.
    """

    def __init__(
        self,
        add: Callable[[SharedMessage], None],
        caught_up: CaughtUp,
        lack: Callable[[], None],
    ) -> None:
        self.step = 0
        self.phase = Phase.WAITING.value
        self.task: Any = None
        self.seats: list[messages.SeatInfo] = []
        self.chat = KeptChat()
        self.notices: deque[tuple[float, SharedMessage]] = deque(maxlen=KEPT_NOTICES)
        self.packets = PacketReader()
        self.lost = True
        self.limits_sight = False
        self._add = add
        self._caught_up = caught_up
        self._lack = lack
        self._now = asyncio.get_running_loop().time
        self._roster: SharedMessage | None = None
        self._text: tuple[int, SharedMessage] | None = None
        self._end: SharedMessage | None = None
        self._state: KeptState | None = None

    @property
    def incomplete(self) -> bool:
        """True if the owner must send a snapshot and the chat again."""
        return self.lost or self.chat.incomplete

    @property
    def text(self) -> SharedMessage | None:
        """The spectators' text view; None if the owner has not sent it, because nobody read it."""
        return self._text[1] if self._text is not None and self._text[0] == self.step else None

    def catch_up(
        self, known: Container[str], *, state: bool, text: bool
    ) -> list[SharedMessage] | None:
        """Return what new spectators need; None if there is no new snapshot.

        Args:
            known: The digests of the tasks that the client has.
            state: True if the client reads states.
            text: True if the client reads texts.
        """
        kept, shown = self._state, self.text
        if kept is None or not kept.good(self._now()) or (text and shown is None):
            return None
        found: list[SharedMessage] = []
        if state:
            found += kept.messages(known=kept.digest in known)
        if text and shown is not None:
            found.append(shown)
            if not state and self._end is not None:
                found.append(self._end)
        return found if self._roster is None else [*found, self._roster]

    def check(self, claim: int) -> None:
        """Notice a new owner, and packets that were lost without a later one that shows it."""
        if self.packets.owned(claim) or self.packets.behind:
            self.lose()

    def lose(self) -> None:
        """Wait for a snapshot, because updates are missing."""
        if not self.lost:
            self.lost, self._state = True, None
            self._lack()

    def receive(self, data: bytes) -> None:
        """Process one message of a relay."""
        try:
            missing, frames = self.packets.read(data)
            if missing:
                self.lose()
            self._process(frames)
        except Exception:
            get_logger().exception("an update of another node was not processed")
            self.lose()

    def _process(self, frames: bytes) -> None:
        fresh = False
        for frame, payload in split(frames):
            fields = msgpack.unpackb(payload)
            kind = fields["type"]
            if kind == "delta":
                self._take_step(fields, frame)
            elif kind == "snapshot":
                self._take_snapshot(fields, frame)
                fresh = True
            elif kind == "observation":
                self._text = fields["step"], SharedMessage(fields, MSGPACK, frame)
            elif kind == "roster":
                self._take_roster(payload, frame, shown=not fresh)
            elif kind == "said":
                self._take_said(payload)
            elif kind == "said_after":
                self.chat.answered_after(fields["number"])
            else:
                self._take_other(fields, frame)

    def _take_step(self, fields: dict[str, Any], frame: bytes) -> None:
        step = fields["step"]
        if self.lost or step <= self.step:
            return
        if step > self.step + 1:
            self.lose()
            return
        self.step = step
        shared = SharedStep(fields, None, MSGPACK, frame)
        if self._state is not None:
            self._state.add(shared)
            if not self._state.good(self._now()):
                self._state = None
        self._add(shared)

    def _take_snapshot(self, fields: dict[str, Any], frame: bytes) -> None:
        if "task" in fields:
            self.task = fields.pop("task")
            frame = SharedMessage(fields).frame(MSGPACK)
        if self.task is None:
            return
        self.limits_sight = not {"sight", "sight_blocked"}.isdisjoint(fields["clock"])
        jumped = self.lost or fields["step"] != self.step
        self.lost = False
        self.step, self.phase = fields["step"], fields["phase"]
        self._show(self.chat.complete(fields.get("said", 0)))
        self._state = KeptState(fields, frame, self.task, self._now())
        if (outcome := fields.get("outcome")) is not None:
            ended = {"type": "ended", "step": self.step, "outcome": outcome}
            self._end = SharedMessage({**ended, "hash": fields["hash"]})
        self._caught_up(jumped=jumped)

    def _take_roster(self, payload: bytes, frame: bytes, *, shown: bool) -> None:
        roster = MSGPACK.decode_server(payload)
        if isinstance(roster, messages.Roster):
            self._roster = SharedMessage(roster, MSGPACK, frame)
            self.seats, self.phase = roster.seats, roster.phase
            # The roster of a snapshot is for those who receive the snapshot.
            if shown:
                self._add(self._roster)

    def _take_said(self, payload: bytes) -> None:
        said = MSGPACK.decode_server(payload)
        if isinstance(said, messages.Said):
            self._show(self.chat.add(said))

    def _show(self, lines: list[messages.Said]) -> None:
        for said in lines:
            self._add(SharedMessage(said))

    def _take_other(self, fields: dict[str, Any], frame: bytes) -> None:
        shared = SharedMessage(fields, MSGPACK, frame)
        if fields["type"] == "notice":
            self.notices.append((self._now(), shared))
        elif fields["type"] == "ended":
            self._end, self.phase = shared, Phase.ENDED.value
        self._add(shared)
