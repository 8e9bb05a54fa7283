"""Spectators of one room. They receive updates together, at most ten times a second.

A room may have hundreds of spectators, so one action of a player can cause hundreds of messages.
Players receive each message at once. Spectators receive all updates since their last delivery in
one write. A delivery spends the event loop's budget for each recipient, so other connections and
the steps of other rooms get their turns in between (docs/decisions/0041).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any

from pydantic import BaseModel

from robotouille.episode import Stepped
from robotouille.protocol import messages
from robotouille.protocol.codec import Codec
from robotouille_server.rooms.participants.session import Session
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.timer_queue import TimerQueue
from robotouille_server.transport import LoopBudget, Peer, frame_of

DELIVERY_SECONDS = 0.1
"""Minimum time between two deliveries. People see no difference from fifty updates a second."""
MAX_STEPS, MAX_STEP_BYTES = 64, 16 * 1024
"""Deltas in one delivery, and their bytes, above which a snapshot replaces them."""
WRITE_COST, KIB_COST, SNAPSHOT_COST = 0.5, 1 / 32, 4.0
"""Cost of a write, of each KiB in it, and of a snapshot, in units of `LoopBudget`."""
KIB = 1024


class SharedMessage:
    """Message to several recipients, encoded once per codec.

    Attributes:
        content: The message, or its fields.
    """

    __slots__ = ("_frames", "content")

    def __init__(
        self,
        content: BaseModel | dict[str, Any],
        codec: Codec | None = None,
        frame: bytes = b"",
    ) -> None:
        self.content = content
        self._frames: dict[Codec, bytes] = {codec: frame} if codec is not None else {}

    def frame(self, codec: Codec) -> bytes:
        """Return the message as a frame, the same for all readers (docs/decisions/0016)."""
        frame = self._frames.get(codec)
        if frame is None:
            content = self.content
            packed = (
                codec.encode(content) if isinstance(content, BaseModel) else codec.pack(content)
            )
            frame = self._frames[codec] = frame_of(packed)
        return frame


class SharedStep(SharedMessage):
    """Delta of a step.

    Attributes:
        event: The step itself, for recipients who read text; None if another node takes the steps.
    """

    __slots__ = ("event",)

    def __init__(
        self, delta: dict[str, Any], event: Stepped | None, codec: Codec, frame: bytes
    ) -> None:
        super().__init__(delta, codec, frame)
        self.event = event


Observe = Callable[[Any], SharedMessage | None]
"""Function that returns the spectators' text view after the event of a step, if there is one."""


class Batch:
    """Updates of one delivery. Recipients with the same view and place share the bytes.

    Args:
        updates: The updates in order.
        observe: Returns the spectators' text view after a step.
    """

    __slots__ = ("_made", "_observe", "_updates")

    def __init__(
        self,
        updates: Sequence[SharedMessage],
        observe: Observe,
    ) -> None:
        self._updates = updates
        self._observe = observe
        self._made: dict[tuple[object, ...], tuple[bytes, int, bool]] = {}

    def frames(
        self, codec: Codec, skipped: int, *, state: bool, text: bool
    ) -> tuple[bytes, int, bool]:
        """Return the updates that a recipient lacks.

        Args:
            codec: The codec of the recipient.
            skipped: The number of updates that the recipient has received already.
            state: True if the recipient wants deltas.
            text: True if the recipient wants observations.

        Returns:
            The frames, their number, and True if a snapshot must follow them.
        """
        key = (codec, skipped, state, text)
        if key not in self._made:
            self._made[key] = self._make(codec, self._updates[skipped:], state, text)
        return self._made[key]

    def _make(
        self, codec: Codec, updates: Sequence[SharedMessage], state: bool, text: bool
    ) -> tuple[bytes, int, bool]:
        steps = [update for update in updates if isinstance(update, SharedStep)]
        rosters = [u for u in updates if isinstance(u.content, messages.Roster)]
        too_many = state and (
            len(steps) > MAX_STEPS or sum(len(s.frame(codec)) for s in steps) > MAX_STEP_BYTES
        )
        found: list[bytes] = []
        for update in updates:
            if isinstance(update, SharedStep):
                if state and not too_many:
                    found.append(update.frame(codec))
                # Texts show a whole state, so the last one replaces all before it.
                if text and update is steps[-1] and (shown := self._observe(update.event)):
                    found.append(shown.frame(codec))
            elif not isinstance(update.content, messages.Roster) or update is rosters[-1]:
                found.append(update.frame(codec))
        return b"".join(found), len(found), too_many


class Audience:
    """Delivers updates to the spectators of a room.

    Args:
        timers: The timers of all rooms.
        budget: The event loop's budget of work per turn.
        observe: Returns the spectators' text view after a step.
        snapshot: Sends a snapshot to a session, which includes everything that is pending, or lets
            it `wait_for_snapshot`.
    """

    __slots__ = (
        "_budget",
        "_delivered",
        "_delivering",
        "_next_at",
        "_observe",
        "_places",
        "_snapshot",
        "_stale",
        "_timers",
        "_updates",
        "_waiting",
    )

    def __init__(
        self,
        timers: TimerQueue,
        budget: LoopBudget,
        observe: Observe,
        snapshot: Callable[[Session], None],
    ) -> None:
        self._timers = timers
        self._budget = budget
        self._observe = observe
        self._snapshot = snapshot
        # A place is the number of updates that a spectator has received or does not need. The
        # first `_delivered` updates are no longer in the list.
        self._places: dict[Session, int] = {}
        self._updates: list[SharedMessage] = []
        self._delivered = 0
        # Spectators who have asked for a snapshot, or have missed steps and can receive one now.
        self._stale: set[Session] = set()
        # Spectators who receive no steps, because they lack the states before them.
        self._waiting: set[Session] = set()
        self._next_at = 0.0
        # True from the time at which a delivery is scheduled until everybody has received it.
        self._delivering = False

    @property
    def _total(self) -> int:
        return self._delivered + len(self._updates)

    def enter(self, session: Session) -> None:
        """Deliver everything from now on to a spectator."""
        self._places[session] = self._total

    def leave(self, session: Session) -> None:
        """Deliver the pending updates to a spectator, and none afterwards."""
        self.catch_up(session)
        self._places.pop(session, None)
        self._stale.discard(session)
        self._waiting.discard(session)

    @property
    def waiting(self) -> Collection[Session]:
        """Spectators who wait for a snapshot."""
        return self._waiting

    def wait_for_snapshot(self, session: Session) -> None:
        """Deliver no steps to a spectator until a snapshot follows."""
        if session in self._places:
            self._waiting.add(session)

    def add(self, update: SharedMessage) -> None:
        """Deliver an update with the next delivery."""
        if not self._places:
            return
        self._updates.append(update)
        self._schedule()

    def ask_snapshot(self, session: Session) -> None:
        """Send a snapshot with the next delivery, so that no spectator gets more than others."""
        if session in self._places:
            self._stale.add(session)
            self._schedule()

    def catch_up(self, session: Session, *, steps: bool = True) -> None:
        """Deliver the pending updates to one spectator, because another message must follow.

        Args:
            session: The spectator.
            steps: False if a snapshot follows, which contains all steps.
        """
        if not steps:
            self._stale.discard(session)
            self._waiting.discard(session)
        if self._places.get(session, self._total) < self._total:
            batch = Batch(self._updates, self._observe)
            self._deliver_to(session, batch, self._total, steps=steps)

    def deliver_now(self) -> None:
        """Deliver the pending updates to everybody, because the server stops."""
        batch = Batch(self._updates, self._observe)
        for session in self._places:
            self._try_deliver_to(session, batch, self._total)

    def _schedule(self) -> None:
        if not self._delivering:
            self._delivering = True
            self._timers.call_at(max(self._next_at, self._timers.time()), self._begin)

    def _begin(self, due: float) -> None:
        self._next_at = max(due, self._timers.time()) + DELIVERY_SECONDS
        batch = Batch(tuple(self._updates), self._observe)
        # The order is reversed, because targets are taken from the end.
        targets = list(reversed(self._places))
        self._budget.wait(partial(self._deliver, batch, self._total, targets))

    def _deliver(self, batch: Batch, until: int, targets: list[Session]) -> None:
        """Deliver a batch until all targets have it or the budget of this turn is used up."""
        budget = self._budget
        while targets and not budget.over:
            session = targets.pop()
            if session in self._places:
                budget.spend(self._try_deliver_to(session, batch, until))
        if targets:
            budget.wait(partial(self._deliver, batch, until, targets))
            return
        del self._updates[: until - self._delivered]
        self._delivered = until
        self._delivering = False
        if self._updates or self._stale:
            self._schedule()

    def _try_deliver_to(self, session: Session, batch: Batch, until: int) -> float:
        """Deliver updates to one spectator; log an error, which must not stop the others' updates.

        A client without its updates notices a gap in the step numbers and asks for a snapshot.
        """
        try:
            return self._deliver_to(session, batch, until)
        except Exception:
            get_logger().exception("a delivery failed", session=session.id)
            return WRITE_COST

    def _deliver_to(
        self, session: Session, batch: Batch, until: int, *, steps: bool = True
    ) -> float:
        """Deliver updates to one spectator, and return the cost."""
        place, peer = self._places[session], session.peer
        stale = session in self._stale
        self._stale.discard(session)
        self._places[session] = max(place, until)
        if peer is None or (place >= until and not stale):
            return 0.0
        # The snapshot of a stale spectator may wait until the recording can be written. Chat does
        # not, so it is sent here.
        withheld = stale or session in self._waiting
        steps = steps and not withheld and self._keeps_up(session, peer)
        frames, count, too_many = batch.frames(
            peer.codec,
            place - self._delivered,
            state=steps and session.wants_state,
            text=steps and session.wants_text,
        )
        cost = 0.0
        if frames:
            peer.send_frame(frames, count)
            cost = WRITE_COST + len(frames) / KIB * KIB_COST
        if stale or too_many:
            self._snapshot(session)
            cost += SNAPSHOT_COST
        return cost

    def _keeps_up(self, session: Session, peer: Peer) -> bool:
        # Chat, rosters and the end are never skipped (docs/decisions/0006).
        return not peer.behind or peer.keeps_up(partial(self.ask_snapshot, session))
