"""History of a live game, which grows with every step."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

from robotouille.domain.rendering import Language, language_of
from robotouille.episode import Clock, Controller
from robotouille.episode.tallies import Activity, activity
from robotouille.replay.rates import recorded_rate
from robotouille.replay.timeline import Interlude
from robotouille.world.world import State
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import (
    ActRejected,
    Announced,
    ChatReceived,
    GameEnded,
    GameEvent,
    RosterChanged,
    StateChanged,
)
from robotouille_client.sansio.state_bytes import state_bytes
from robotouille_client.window.replay.histories.history import (
    Entry,
    EntryKind,
    History,
    HistoryWording,
)
from robotouille_client.window.sources.texts import outcome_words, speaker
from robotouille_client.window.view import SeatView

# Maximum number of states kept. In longer games, the oldest are dropped.
MAX_STATES = 20_000
_FORGOTTEN_AT_ONCE = 1000
# Maximum memory of the states kept. Beyond it, the older half is dropped.
MAX_STATE_BYTES = 64 * 2**20
# Maximum number of characters in the log. Beyond it, the older half of the texts is dropped.
MAX_CHARACTERS = 16 * 2**20
# Characters for which an event without words counts.
_EVENT_CHARACTERS = 100
# Maximum number of reasons of an event, and of characters in each text. Servers send any number.
_MAX_REASONS, _MAX_TEXT = 16, 500


class LiveHistory(History):
    """History of a game from the step at which its participant or spectator joined.

    It contains only what the server sent. The rejected requests of others are only counted.

    Args:
        now: Clock in seconds.
        language: Words of the log. Default: the domain's own.
    """

    def __init__(
        self, game: Game, now: Callable[[], float], language: Language | None = None
    ) -> None:
        super().__init__(game.world)
        self._game = game
        self._now = now
        self._began = now()
        self._wording = HistoryWording(game.world, language or language_of(game.world.task))
        self._states: list[State] = []
        self._seats: list[tuple[SeatView, ...]] = []
        self._entries: dict[int, list[Entry]] = defaultdict(list)
        self._characters = 0
        self._rejected = self._rejections()
        self._turn = game.turn
        self._paused = False
        self.max_steps = game.clock.get("max_steps")
        self.rate = recorded_rate(game.clock)
        self.first = game.step
        while self.length < game.step:
            self._add_step(0, {})
        # Steps before this client joined are counted, but their states are unknown.
        self._states = [game.state]
        self._state_bytes = state_bytes(game.state)
        self._seats = [()]

    @property
    def outcome(self) -> Mapping[str, object] | None:
        return self._game.outcome

    def state(self, step: int) -> State:
        return self._states[min(max(0, step - self.first), len(self._states) - 1)]

    def seats(self, step: int) -> tuple[SeatView, ...]:
        return self._seats[min(max(0, step - self.first), len(self._seats) - 1)]

    def entries(self, step: int) -> tuple[Entry, ...]:
        return tuple(self._entries.get(step, ()))

    def set_seats(self, seats: tuple[SeatView, ...]) -> None:
        """Set the seats of the last step."""
        self._seats[-1] = seats

    def observe(self, event: GameEvent) -> None:
        """Record an event of the game."""
        match event:
            case StateChanged() if event.step > self.length:
                self._take(event)
            case ChatReceived():
                self._said.append((self.length, speaker(event.name, event.seat), event.text))
                target = "" if event.signal is None else event.signal.target
                self._note(EntryKind.SAID, event.text, event.seat, target)
            case Announced():
                text = event.text[:_MAX_TEXT]
                self._said.append((self.length, "", text))
                self.interludes.append(Interlude(self.length, f"The operator: {text}"))
                self._note(EntryKind.ANNOUNCED, text)
            case ActRejected() if event.seat:
                self._reject(event)
            case RosterChanged():
                if event.pause is not None and not self._paused:
                    self._note(EntryKind.PAUSED, f"paused: {event.pause.reason}")
                self._paused = event.pause is not None
            case GameEnded() if event.outcome:
                self._note(EntryKind.ENDED, outcome_words(event.outcome))

    def _note(
        self,
        kind: EntryKind,
        words: str,
        player: str = "",
        target: str = "",
        reasons: Sequence[str] = (),
    ) -> None:
        """Log an event after the last step."""
        why = tuple(reason[:_MAX_TEXT] for reason in reasons[:_MAX_REASONS])
        entry = Entry(self.length, kind, player, words[:_MAX_TEXT], why, target)
        self._entries[entry.step].append(entry)
        self._mark([entry])
        self._characters += _characters(entry)
        if self._characters > MAX_CHARACTERS:
            self._forget_texts()

    def _forget_texts(self) -> None:
        """Drop the older half of the log, the chat and the announcements."""
        entries = [entry for step in self._entries.values() for entry in step]
        self._entries = defaultdict(list)
        for entry in entries[len(entries) // 2 :]:
            self._entries[entry.step].append(entry)
        del self._said[: len(self._said) // 2]
        del self.interludes[: len(self.interludes) // 2]
        self._count_characters()

    def _count_characters(self) -> None:
        entries = (entry for step in self._entries.values() for entry in step)
        self._characters = sum(map(_characters, entries))

    def _reject(self, event: ActRejected) -> None:
        context = (self._states[-1], self._names())
        does = self._wording.attempt({"player": event.seat, "action": event.action}, *context)
        why = self._wording.unmet(event.unmet[:_MAX_REASONS], *context)
        self._note(EntryKind.REJECTED, does, event.seat, reasons=why)

    def _names(self) -> dict[str, str]:
        return {seat.player: seat.name for seat in self._game.seats if seat.name}

    def _take(self, event: StateChanged) -> None:
        """Add a step. Missed steps before it are added without their states and actions."""
        before, seats = self._states[-1], self._seats[-1]
        # After a resync, the server reports only the newest state.
        while self.length < event.step - 1:
            self._add_step(self._time(), {})
            self._keep(before, seats)
        did = self._did(event) if event.previous is not None else {}
        self._add_step(self._time(), did)
        self._keep(event.state, seats)
        for player, action, applied in event.did:
            kind = EntryKind.ACTION if applied else EntryKind.REJECTED
            does = self._wording.action(action, before, self._names())
            self._note(kind, does, player)
        self._turn = event.turn
        self._forget()

    def _keep(self, state: State, seats: tuple[SeatView, ...]) -> None:
        # Missed steps share the state before them, which takes memory only once.
        if state is not self._states[-1]:
            self._state_bytes += state_bytes(state)
        self._states.append(state)
        self._seats.append(seats)

    def _forget(self) -> None:
        """Drop the oldest states if there are too many, or if they take too much memory."""
        if len(self._states) >= MAX_STATES + _FORGOTTEN_AT_ONCE:
            self._forget_states(_FORGOTTEN_AT_ONCE)
        while self._state_bytes > MAX_STATE_BYTES and len(self._states) > 1:
            self._forget_states(len(self._states) // 2)

    def _forget_states(self, count: int) -> None:
        dropped = pairwise(self._states[: count + 1])
        self._state_bytes -= sum(
            state_bytes(state) for state, after in dropped if state is not after
        )
        del self._states[:count], self._seats[:count]
        self.first += count
        self._entries = defaultdict(
            list, {step: entries for step, entries in self._entries.items() if step >= self.first}
        )
        self._count_characters()

    def _did(self, event: StateChanged) -> dict[str, Activity]:
        """Return what each seat did in a step, as far as the server reported it."""
        applied = {player: applied for player, _, applied in event.did}
        before, rejected = self._rejected, self._rejections()
        self._rejected = rejected
        return {
            seat.player: activity(
                _controller(seat.controller),
                applied.get(seat.player),
                event.previous is not None and event.previous.busy_steps(seat.player) > 0,
                rejected[seat.player] > before.get(seat.player, 0) or seat.player in event.waits,
                self._turn is not None and self._turn != seat.player,
            )
            for seat in self._game.seats
        }

    def _rejections(self) -> dict[str, int]:
        return {seat.player: seat.rejected for seat in self._game.seats}

    def _time(self) -> int:
        if self._game.clock.get("clock") == Clock.REALTIME:
            return round(1000 * (self.length + 1) / self.rate)
        return round(1000 * (self._now() - self._began))


def _characters(entry: Entry) -> int:
    return _EVENT_CHARACTERS + len(entry.words) + sum(map(len, entry.reasons))


def _controller(name: str) -> Controller:
    """Return a seat's controller. Controllers of a newer server count as bots."""
    try:
        return Controller(name)
    except ValueError:
        return Controller.BOT
