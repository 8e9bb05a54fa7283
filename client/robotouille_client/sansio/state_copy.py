"""A participant's copy of the world's state, read from snapshots and deltas."""

from __future__ import annotations

from robotouille.domain.task import Task
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.states import StateReader
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.sight import Seen
from robotouille.world.world import State, shared_world


class StateCopy:
    """The state as the participant of some seats receives it.

    Attributes:
        hidden: The objects out of sight; None if the client receives the whole state.
    """

    def __init__(self, seat: str | None, own_seats: tuple[str, ...]) -> None:
        self._seat = seat
        self._own_seats = own_seats
        self._reader: StateReader | None = None
        self.hidden: frozenset[str] | None = None

    @property
    def known(self) -> bool:
        """True once a snapshot has arrived."""
        return self._reader is not None

    @property
    def state(self) -> State:
        """The current state. RuntimeError if no snapshot has arrived."""
        return self._known_reader().state

    @property
    def actions(self) -> tuple[GroundAction, ...]:
        """The valid actions of the first seat; with limited sight, those that seem valid."""
        if self.hidden is None or self._seat is None:
            return self.state.actions(self._seat) if self._seat else ()
        return self._seen(self.hidden).actions_of(self._seat)

    @property
    def text_view(self) -> str:
        """The state in words for the first seat, or for a spectator."""
        if self.hidden is None or self._seat is None:
            return self.state.text_view(self._seat)
        return self._seen(self.hidden).text_view(self._seat)

    def _seen(self, hidden: frozenset[str]) -> Seen:
        things = frozenset(thing.name for thing in self.state.objects) - hidden
        return Seen(self.state, things, self._own_seats)

    def _known_reader(self) -> StateReader:
        if self._reader is None:
            raise RuntimeError("no state: the view is 'text', or no snapshot has arrived yet")
        return self._reader

    def read(self, message: messages.Snapshot) -> None:
        """Replace the state by that of a snapshot.

        Raises:
            ProtocolError: The snapshot is inconsistent, or the first one has no task.
        """
        if message.task is not None:
            world = shared_world(Task.from_json(message.task, "the server's task"))
        elif self._reader is not None:
            world = self._reader.world
        else:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "the first snapshot contains no task")
        values = message.model_dump(include={"facts", "timers", "busy", "orders"})
        tables = message.model_dump(include={"predicates", "objects", "atoms"})
        reader = StateReader(world, tables, values)
        if reader.state.digest != message.hash:
            fault = "the snapshot's hash does not match its state"
            raise ProtocolError(ErrorCode.STATE_MISMATCH, fault)
        self._reader = reader
        self.hidden = None if message.hidden is None else frozenset(message.hidden)

    def apply(self, message: messages.Delta) -> State | None:
        """Apply a delta and return the new state, or None if a snapshot is needed."""
        try:
            state = self._known_reader().apply(message.model_dump(exclude_defaults=True))
        except ProtocolError:
            return None
        # Only every tenth delta has a hash, because hashing a state costs time.
        if message.hash is not None and state.digest != message.hash:
            return None
        if message.hidden is not None:
            self.hidden = frozenset(message.hidden)
        return state
