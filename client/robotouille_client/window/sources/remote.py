"""Game on a server."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from robotouille.domain.rendering import Language, language_of
from robotouille.episode import Controller
from robotouille.protocol import messages
from robotouille.protocol.messages import SeatInfo
from robotouille.replay.rates import real_time_rate
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Signal
from robotouille.world.presentation.wording import Wording
from robotouille.world.unmet import only_words
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import (
    ActRejected,
    Announced,
    ChatReceived,
    ChatRejected,
    ChatRepeated,
    GameEnded,
    GameEvent,
    RosterChanged,
    StateChanged,
)
from robotouille_client.window.sources.blockages import Blockages, TakenStep
from robotouille_client.window.sources.feedback import ChatLog, Feedback
from robotouille_client.window.sources.playout import Playout, ShownStep
from robotouille_client.window.sources.texts import (
    clock_words,
    comings_and_goings,
    farewell,
    outcome_words,
    pause_words,
    readiness,
    speaker,
    waiting_words,
    won,
)
from robotouille_client.window.view import (
    GLIDE_SECONDS,
    FarewellView,
    GameSource,
    LobbyRow,
    LobbyView,
    PauseView,
    SeatView,
    View,
)


class _Countdown:
    """Countdown of a pause, which runs on between the server's messages."""

    def __init__(self) -> None:
        self._last: messages.Pause | None = None
        self._until = 0.0
        self._whole = 0.0

    def left(self, pause: messages.Pause, now: float) -> float | None:
        """Return the seconds until the pause ends by itself; None if it has no limit."""
        if pause is not self._last:
            # The server repeats the message as the rest gets shorter. Only a new reason starts a
            # new countdown; otherwise the bar would jump back to full.
            new = self._last is None or self._last.reason != pause.reason
            self._last, self._until = pause, now + (pause.left or 0.0)
            self._whole = max(0.0 if new else self._whole, pause.left or 0.0)
        return None if pause.left is None else max(0.0, self._until - now)

    def share(self, left: float | None) -> float:
        """Return the part of the whole wait that is left, from 1 to 0."""
        if left is None or self._whole <= 0.0:
            return 1.0
        return min(1.0, left / self._whole)

    def reset(self) -> None:
        """Forget the pause, so that the next one starts a new countdown."""
        self._last = None


class RemoteSource(GameSource):
    """Episode on a server.

    Args:
        connected: Function that returns whether there is a connection.
        language: Words for actions and things; None for the domain's own.
        observe: Function that receives each event.
        news: Function that returns new lines for the chat.
    """

    def __init__(
        self,
        game: Game,
        now: Callable[[], float],
        connected: Callable[[], bool] = lambda: True,
        language: Language | None = None,
        observe: Callable[[GameEvent], None] = lambda event: None,
        news: Callable[[], Iterable[str]] = lambda: (),
    ) -> None:
        self._game = game
        self._connected = connected
        self._observe = observe
        self._news = news
        self._now = now
        self._language = language
        self._chat_log = ChatLog(now)
        self._blockages = Blockages(now)
        self._feedback = Feedback(self._chat_log, self._blockages)
        self._countdown = _Countdown()
        self._seats: tuple[SeatInfo, ...] = ()
        self._shown = ShownStep(game.step, game.state, None) if game.has_state else None
        self._playout: Playout | None = None
        self._lost_at: float | None = None
        self._ended_at: float | None = None
        self._farewell: FarewellView | None = None

    def view(self) -> View:
        self._take_events()
        game, shown = self._game, self._moment()
        return View(
            world=game.world,
            state=shown.state,
            previous=shown.previous,
            step=shown.step,
            max_steps=game.clock.get("max_steps"),
            clock=clock_words(
                str(game.clock.get("clock", "")), game.clock, len(game.world.players)
            ),
            phase=shown.phase,
            step_seconds=self._period(),
            seats=tuple(map(self._seat, game.seats)),
            me=game.seat,
            bubbles=self._chat_log.bubbles,
            chat=self._chat_log.lines,
            status=self._status(),
            lobby=self._lobby(),
            starts_in=self._starts_in(),
            watching=game.spectators,
            spectator_names=game.spectator_names,
            blocked=self._blockages.at(game.state) if game.running else (),
            waits_for=game.waits_for if game.running and self._connected() else (),
            code=game.code,
            outcome=outcome_words(game.outcome) if game.outcome else "",
            won=won(game.outcome),
            notice=self._chat_log.notice,
            pause=self._pause(),
            offline=self._offline(),
            farewell=self._farewell,
            seconds=self._now(),
            since_end=None if self._ended_at is None else self._now() - self._ended_at,
        )

    def _take_events(self) -> None:
        game = self._game
        for text in self._news():
            self._chat_log.happened(text)
        for event in game.poll():
            self._observe(event)
            match event:
                case StateChanged():
                    self._take_step(event)
                    self._show_rejections(event)
                    step = TakenStep(event.previous, event.state, event.did, event.waits)
                    self._feedback.stepped(step, self._wording)
                case ActRejected() if game.seat:
                    why = game.seat, event.action, event.unmet
                    self._feedback.show_rejection(*why, game.state, self._wording)
                case ChatReceived():
                    self._feedback.show_speech(event, event.seat, game.state, self._wording)
                case ChatRepeated():
                    # No bubbles: the messages may be old.
                    self._chat_log.repeated(speaker(event.name, event.seat), event.text)
                case ChatRejected():
                    self._chat_log.happened(event.reason)
                case RosterChanged():
                    for news in comings_and_goings(self._seats, event.seats, game.seat):
                        self._chat_log.happened(news)
                    self._seats = event.seats
                case Announced():
                    self._chat_log.announced(event.text)
                case GameEnded() if event.outcome:
                    self._ended_at = self._now()
                    self._chat_log.ended()
                case GameEnded():
                    self._farewell = farewell(event.code, event.reason)
                case _:
                    pass

    @property
    def _wording(self) -> Wording:
        game = self._game
        if self._language is None:
            self._language = language_of(game.world.task)
        # Names change with each roster, so only the language is kept.
        names = {s.player: s.name for s in game.seats if s.name and s.player != game.seat}
        return Wording(game.world, self._language, game.seat, names)

    def _seat(self, seat: SeatInfo) -> SeatView:
        by_bot = seat.controller == Controller.SUBSTITUTE
        substitute = str(self._game.clock.get("substitute", "bot")) if by_bot else ""
        return SeatView(
            seat.player, seat.name, seat.kind, seat.present, seat.acted, seat.rejected, substitute,
            seat.latency_ms,
        )  # fmt: skip

    def _pause(self) -> PauseView | None:
        game = self._game
        if game.pause is None or not game.paused or game.ended:
            self._countdown.reset()
            return None
        left = self._countdown.left(game.pause, self._now())
        why, detail = pause_words(game.pause.reason, game.seats, left)
        return PauseView(why, detail, left, self._countdown.share(left))

    def _lobby(self) -> LobbyView | None:
        """Return the seats of a game that has not started, with the player's own first."""
        game = self._game
        if game.phase != "waiting" or game.ended:
            return None
        own = [seat for seat in game.seats if seat.player in game.own_seats]
        others = [seat for seat in game.seats if seat.player not in game.own_seats]
        rows = [LobbyRow(f"{seat.name} (you)", readiness(seat)) for seat in own]
        rows += [LobbyRow(seat.name or seat.player, readiness(seat)) for seat in others]
        return LobbyView(tuple(rows), game.is_ready if own else None, game.code)

    def _starts_in(self) -> float | None:
        """Return the seconds of the countdown to the start; None without a countdown."""
        starts_at = self._game.starts_at
        waiting = starts_at is not None and self._game.phase == "waiting" and self._connected()
        return max(0.0, starts_at - self._now()) if starts_at is not None and waiting else None

    def _offline(self) -> float | None:
        """Return for how many seconds the connection has been lost; None while connected."""
        if self._connected() or self._game.ended:
            self._lost_at = None
            return None
        # The client reconnects by itself; the seconds show that it keeps trying.
        now = self._now()
        if self._lost_at is None:
            self._lost_at = now
        return now - self._lost_at

    def _show_rejections(self, event: StateChanged) -> None:
        # The action was valid when it was sent, and another player's action came first.
        for player, action, applied in event.did:
            if not applied:
                does = self._wording.action(action, event.state)
                self._chat_log.rejected(player, only_words(f"too late to {does}"))

    def _take_step(self, event: StateChanged) -> None:
        """Queue a new step or snapshot to be shown."""
        # Without a clock there is nothing to smooth. The same applies to a rate that the screen
        # cannot show.
        period = self._period()
        self._shown = ShownStep(event.step, event.state, event.previous)
        if period is None:
            return
        if self._playout is None:
            self._playout = Playout(period)
        self._playout.add(event.step, event.state, event.previous)
        # `step_time` is known only for the newest step. After a frame that took long, several
        # steps are taken at once, and older ones would count as late.
        if event.step == self._game.step:
            self._playout.arrived(event.step, self._game.step_time)

    def _moment(self) -> ShownStep:
        """Return what to show now: smoothed in real time, else the newest step."""
        moment = self._playout.at(self._now()) if self._playout is not None else None
        if moment is not None:
            return moment
        # Steps that wait for decisions have no even pace, so each is shown when it arrives.
        game, newest = self._game, self._shown
        elapsed = self._now() - game.step_time
        phase = min(1.0, max(0.0, elapsed / (self._period() or GLIDE_SECONDS)))
        return ShownStep(game.step, game.state, newest.previous if newest else None, phase)

    def _period(self) -> float | None:
        """Return the seconds of a step; None if the clock has no fixed one."""
        rate = real_time_rate(self._game.clock)
        return None if rate is None else 1 / rate

    def _status(self) -> str:
        game = self._game
        if game.ended:
            return "You're out of the game" if not game.outcome else ""
        if not self._connected():
            return "Connection lost"
        if game.paused:
            return "Paused"
        if game.phase == "waiting":
            return waiting_words(game.seats, self._starts_in(), game.seat)
        if game.turn is not None:
            names = {seat.player: seat.name for seat in game.seats}
            whose = f"{names.get(game.turn) or game.turn}'s turn"
            return "Your turn" if game.turn == game.seat else whose
        return ""

    def act(self, action: GroundAction) -> None:
        # While offline, actions would pile up and run late after the reconnection.
        if self._game.running and self._connected():
            self._game.submit(action)

    def say(self, text: str) -> None:
        self._game.say(text)

    def signal(self, signal: Signal) -> None:
        if self._game.own_seats:
            self._game.signal(*signal)

    def be_ready(self, ready: bool) -> None:
        # Spectators have no seat to get ready for, and send the server nothing.
        if self._game.own_seats:
            self._game.ready(ready)

    @property
    def outcome(self) -> Mapping[str, Any] | None:
        """The outcome, once the server has sent it."""
        return self._game.outcome

    @property
    def finished(self) -> bool:
        return self._game.ended
