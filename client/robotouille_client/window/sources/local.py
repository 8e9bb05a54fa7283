"""A game in this process as a window's source."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from robotouille.domain.rendering import language_of
from robotouille.episode import (
    Ended,
    Episode,
    Event,
    Phase,
    Rejected,
    Said,
    Stepped,
)
from robotouille.errors import ProtocolError
from robotouille.planning.policies.policy import Policy, TeamPolicy
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.wording import Wording
from robotouille.world.unmet import only_words
from robotouille.world.world import State
from robotouille_client.window.sources.blockages import Blockages
from robotouille_client.window.sources.chat_log import ChatLog
from robotouille_client.window.sources.texts import clock_words, outcome_words, waiting_words
from robotouille_client.window.view import GLIDE_SECONDS, SeatView, View

__all__ = ["LocalSource"]


class LocalSource:
    """An episode in this process; bots play the seats of others.

    `record` is given all that happens, in order.
    """

    def __init__(
        self,
        episode: Episode,
        me: str,
        bots: Mapping[str, tuple[str, Policy]],
        now: Callable[[], float],
        *,
        name: str = "you",
        record: Callable[[Iterable[Event]], None] | None = None,
    ) -> None:
        self._episode = episode
        self._me = me
        self._bots = bots
        self._now = now
        self._name = name
        self._record = record
        names = {player: bot for player, (bot, _) in bots.items()}
        self._wording = Wording(episode.world, language_of(episode.world.task), me, names)
        self._chat_log = ChatLog(now)
        self._blockages = Blockages(now)
        self._previous: State | None = None
        self._seq: dict[str, int] = dict.fromkeys(episode.world.players, 0)
        self._step_time = now()
        self._decided = dict.fromkeys(bots, -1)
        self._ready: set[str] = set()
        episode.join(me, name, "human", now())
        for player, (bot, _) in bots.items():
            episode.join(player, bot, "bot", now())
        self._introduce()

    def view(self) -> View:
        self._episode.tick(self._now())
        self._take_events()  # A bot decides on a state once it has been told what led to it.
        self._let_bots_move()
        self._take_events()
        episode = self._episode
        rules = episode.rules
        scheduled = rules.scheduled
        elapsed = self._now() - self._step_time
        outcome = episode.outcome
        return View(
            world=episode.world,
            state=episode.state,
            previous=self._previous,
            step=episode.step,
            max_steps=rules.max_steps,
            clock=clock_words(rules.clock.value, rules.model_dump(mode="json")),
            phase=min(1.0, elapsed / (rules.period if scheduled else GLIDE_SECONDS)),
            step_seconds=rules.period if scheduled else None,
            seats=tuple(
                SeatView(s.player, s.name, s.kind, s.present, s.tally.acted, s.tally.rejected)
                for s in episode.seats.values()
            ),
            me=self._me,
            bubbles=self._chat_log.bubbles,
            chat=self._chat_log.lines,
            status=self._status(),
            outcome=outcome_words(outcome.to_json()) if outcome else "",
            won=outcome is not None and outcome.success,
            starts_in=self._starts_in(),
            blocked=self._blockages.at(episode.state) if episode.running else (),
        )

    def _status(self) -> str:
        starts_in = self._starts_in()
        if starts_in is not None:
            return waiting_words((), starts_in)
        turn = self._episode.on_turn
        if turn is None:
            return ""
        return "Your turn" if turn == self._me else f"{turn}'s turn"

    def _starts_in(self) -> float | None:
        starts_at = self._episode.starts_at
        return None if starts_at is None else max(0.0, starts_at - self._now())

    def _introduce(self) -> None:
        """Tell the bots who plays what: they count on one another, and not on people."""
        seats, clock = self._episode.seats.values(), self._episode.rules.clock.value
        for _, policy in self._bots.values():
            if isinstance(policy, TeamPolicy):
                policy.meet({seat.player: seat.controller.value for seat in seats}, clock)

    def _let_bots_speak(self) -> None:
        for player, (name, policy) in self._bots.items():
            if isinstance(policy, TeamPolicy):
                for text in policy.speak():
                    self._episode.say(name, player, text, self._now())

    def _hear(self, event: Said) -> None:
        self._chat_log.said(event.name, event.player, event.text)
        state = self._episode.state
        self._blockages.said(event.player, event.text, state, self._wording)
        for player, (_, policy) in self._bots.items():
            if isinstance(policy, TeamPolicy) and player != event.player:
                policy.hear(event.player, event.text)

    def _let_bots_move(self) -> None:
        """At most one bot thinks in a frame, so that the window stays smooth."""
        episode = self._episode
        if episode.starts_at is not None:
            self._let_a_bot_get_ready()
        for player, (_, policy) in self._bots.items():
            may = episode.on_turn in (None, player) and not episode.state.busy_steps(player)
            if episode.phase is Phase.RUNNING and may and self._decided[player] < episode.step:
                self._decided[player] = episode.step
                self._submit(player, policy.act(episode.state))
                break
        if not episode.ended:
            self._let_bots_speak()

    def _let_a_bot_get_ready(self) -> None:
        """Its first plan takes longest: it is made while the game is counted down to."""
        for player, (_, policy) in self._bots.items():
            if player not in self._ready:
                self._ready.add(player)
                policy.act(self._episode.state)
                return

    def _submit(self, player: str, action: GroundAction | None) -> None:
        self._seq[player] += 1
        try:
            self._episode.submit(player, self._seq[player], action, self._now())
        except ProtocolError as error:
            self._chat_log.rejected(player, only_words(error.message))

    def _take_events(self) -> None:
        events = list(self._episode.events())
        if self._record is not None and events:
            self._record(events)
        for event in events:
            match event:
                case Stepped():
                    self._previous, self._step_time = event.before, self._now()
                    for move, attempt in zip(event.moves, event.attempts, strict=True):
                        self._blockages.refused(move.player, attempt.unmet, event.state)
                    did = [
                        (move.player, move.action, attempt.applied)
                        for move, attempt in zip(event.moves, event.attempts, strict=True)
                    ]
                    for player, (_, policy) in self._bots.items():
                        policy.observe(did)
                        self._decided[player] = min(self._decided[player], event.step - 1)
                case Rejected():
                    say = partial(self._wording.reason, state=self._episode.state)
                    self._chat_log.rejected(event.player, event.unmet, say)
                    self._blockages.refused(event.player, event.unmet, self._episode.state)
                case Said():
                    self._hear(event)
                case Ended():
                    self._step_time = self._now()
                case _:
                    pass

    def act(self, action: GroundAction) -> None:
        self._submit(self._me, action)

    def say(self, text: str) -> None:
        self._episode.say(self._name, self._me, text, self._now())

    @property
    def outcome(self) -> dict[str, Any] | None:
        """How the game ended, once it has, as recordings tell it."""
        outcome = self._episode.outcome
        return outcome.to_json() if outcome else None

    @property
    def finished(self) -> bool:
        return self._episode.phase is Phase.ENDED
