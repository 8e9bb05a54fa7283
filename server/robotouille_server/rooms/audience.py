"""Spectators of one room. They receive updates together, at most ten times a second.

A room may have hundreds of spectators, so one action of a player can cause hundreds of messages.
Players receive each message at once. Spectators receive all updates since their last delivery in
one write. A delivery spends the event loop's budget for each recipient, so other connections and
the steps of other rooms get their turns in between (docs/decisions/0041).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any, NamedTuple

from pydantic import BaseModel

from robotouille.protocol import messages
from robotouille.protocol.codec import Codec
from robotouille_server.rooms.session import Session
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

    @property
    def is_roster(self) -> bool:
        content = self.content
        if isinstance(content, dict):
            return content.get("type") == "roster"
        return isinstance(content, messages.Roster)

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
        text: Returns the spectators' text view after the step; None if there is no such view.
    """

    __slots__ = ("text",)

    def __init__(
        self,
        delta: dict[str, Any],
        codec: Codec,
        frame: bytes,
        text: Callable[[], SharedMessage | None],
    ) -> None:
        super().__init__(delta, codec, frame)
        self.text = text


class View(NamedTuple):
    """Part of a batch that a recipient receives.

    Attributes:
        state: True if it receives deltas.
        text: True if it receives observations.
        waits: True if it receives both only after the next snapshot.
        knows_task: True if that snapshot can leave out the task.
    """

    state: bool
    text: bool
    waits: bool = False
    knows_task: bool = False


class SharedSnapshot(SharedMessage):
    """Snapshot for all spectators of an audience who wait for one.

    Args:
        fields: The fields of the snapshot, without the task.
        task: The task.
        texts: The texts for recipients who read them; None if this snapshot is not for them.

    Attributes:
        digest: The digest of the task.
    """

    __slots__ = ("_with_task", "digest", "texts")

    def __init__(
        self, fields: dict[str, Any], task: dict[str, Any], texts: Sequence[SharedMessage] | None
    ) -> None:
        super().__init__(fields)
        self._with_task = SharedMessage({**fields, "task": task})
        self.digest = str(fields["digest"])
        self.texts = texts

    def frames(self, codec: Codec, view: View) -> list[bytes]:
        """Return the frames for a recipient."""
        found = []
        if view.state:
            found.append((self if view.knows_task else self._with_task).frame(codec))
        if view.text:
            found += [text.frame(codec) for text in self.texts or ()]
        return found


class Delivery(NamedTuple):
    """Updates of a batch for some of its recipients.

    Attributes:
        frames: The frames.
        messages: Their number.
        too_many: True if a snapshot must follow them.
        caught_up: True if they contain a snapshot for which the recipients have waited.
    """

    frames: bytes
    messages: int
    too_many: bool
    caught_up: bool


class Batch:
    """Updates of one delivery. Recipients with the same view and place share the bytes."""

    __slots__ = ("_made", "_updates")

    def __init__(self, updates: Sequence[SharedMessage]) -> None:
        self._updates = updates
        self._made: dict[tuple[Codec, int, View], Delivery] = {}

    def delivery(self, codec: Codec, skipped: int, view: View) -> Delivery:
        """Return the updates that a recipient lacks.

        Args:
            codec: The codec of the recipient.
            skipped: The number of updates that the recipient has received already.
            view: The messages that the recipient receives: states, texts or both.
        """
        key = (codec, skipped, view)
        if key not in self._made:
            self._made[key] = self._make(codec, self._updates[skipped:], view)
        return self._made[key]

    def snapshot(self, skipped: int, *, text: bool) -> SharedSnapshot | None:
        """Return the last snapshot among the updates that a recipient lacks."""
        found = _last_snapshot(self._updates[skipped:], text=text)
        return found[1] if found is not None else None

    def _make(self, codec: Codec, updates: Sequence[SharedMessage], view: View) -> Delivery:
        waited = _last_snapshot(updates, text=view.text) if view.waits else None
        begin = 0
        if waited is not None:
            begin = waited[0]
        elif view.waits:
            begin = len(updates)
        steps = [update for update in updates[begin:] if isinstance(update, SharedStep)]
        rosters = [update for update in updates if update.is_roster]
        too_many = view.state and (
            len(steps) > MAX_STEPS or sum(len(s.frame(codec)) for s in steps) > MAX_STEP_BYTES
        )
        found: list[bytes] = []
        for place, update in enumerate(updates):
            if isinstance(update, SharedStep):
                if view.state and not too_many and place >= begin:
                    found.append(update.frame(codec))
                # Texts show a whole state, so the last one replaces all before it.
                if view.text and steps and update is steps[-1] and (text := update.text()):
                    found.append(text.frame(codec))
            elif isinstance(update, SharedSnapshot):
                if waited is not None and update is waited[1]:
                    found += update.frames(codec, view)
            elif not update.is_roster or update is rosters[-1]:
                found.append(update.frame(codec))
        return Delivery(b"".join(found), len(found), too_many, waited is not None)


def _last_snapshot(
    updates: Sequence[SharedMessage], *, text: bool
) -> tuple[int, SharedSnapshot] | None:
    """Return the last snapshot that a recipient can use, and its place."""
    for place in range(len(updates) - 1, -1, -1):
        update = updates[place]
        if isinstance(update, SharedSnapshot) and (update.texts is not None or not text):
            return place, update
    return None


class Audience:
    """Delivers updates to the spectators of a room.

    Args:
        timers: The timers of all rooms.
        budget: The event loop's budget of work per turn.
        snapshot: Sends a snapshot to a session, which includes everything that is pending. If the
            snapshot comes later, as an update for all, it calls `wait_for_snapshot`.
    """

    __slots__ = (
        "_budget",
        "_delivered",
        "_delivering",
        "_next_at",
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
        snapshot: Callable[[Session], None],
    ) -> None:
        self._timers = timers
        self._budget = budget
        self._snapshot = snapshot
        # A place is the number of updates that a spectator has received or does not need. The
        # first `_delivered` updates are no longer in the list.
        self._places: dict[Session, int] = {}
        self._updates: list[SharedMessage] = []
        self._delivered = 0
        # Spectators who have asked for a snapshot, or have missed steps and can receive one now.
        self._stale: set[Session] = set()
        # Spectators who receive no steps until a snapshot is among the updates.
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
        """Spectators who wait for a snapshot among the updates."""
        return self._waiting

    def wait_for_snapshot(self, session: Session) -> None:
        """Deliver no steps to a spectator until a `SharedSnapshot` is added."""
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
        if self._places.get(session, self._total) < self._total:
            batch = Batch(self._updates)
            self._deliver_to(session, batch, self._total, steps=steps)

    def deliver_now(self) -> None:
        """Deliver the pending updates to everybody, because the server stops."""
        batch = Batch(self._updates)
        for session in self._places:
            self._try_deliver_to(session, batch, self._total)

    def _schedule(self) -> None:
        if not self._delivering:
            self._delivering = True
            self._timers.call_at(max(self._next_at, self._timers.time()), self._begin)

    def _begin(self, due: float) -> None:
        self._next_at = max(due, self._timers.time()) + DELIVERY_SECONDS
        batch = Batch(tuple(self._updates))
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
        steps = steps and not stale and self._keeps_up(session, peer)
        skipped = place - self._delivered
        found = batch.delivery(peer.codec, skipped, self._view(session, batch, skipped, steps))
        cost = 0.0
        if found.frames:
            peer.send_frame(found.frames, found.messages)
            cost = WRITE_COST + len(found.frames) / KIB * KIB_COST
        if found.caught_up:
            self._waiting.discard(session)
        if stale or found.too_many:
            self._snapshot(session)
            cost += SNAPSHOT_COST
        return cost

    def _view(self, session: Session, batch: Batch, skipped: int, steps: bool) -> View:
        """Return what a spectator receives of a batch."""
        state, text = steps and session.wants_state, steps and session.wants_text
        if not steps or session not in self._waiting:
            return View(state, text)
        snapshot = batch.snapshot(skipped, text=text)
        knows_task = snapshot is not None and snapshot.digest in session.known
        if snapshot is not None and state:
            # From now on the client has the task: frames are delivered in order or not at all.
            session.known.add(snapshot.digest)
        return View(state, text, waits=True, knows_task=knows_task)

    def _keeps_up(self, session: Session, peer: Peer) -> bool:
        # Chat, rosters and the end are never skipped (docs/decisions/0006).
        return not peer.behind or peer.keeps_up(partial(self.ask_snapshot, session))
