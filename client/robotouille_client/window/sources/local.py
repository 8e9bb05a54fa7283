"""Game in this process, with bots as teammates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.episode import (
    TEAM_TOPIC,
    ActionRejected,
    ActionRequest,
    ChatPosted,
    Episode,
    EpisodeEnded,
    Event,
    Phase,
    Stepped,
)
from robotouille.episode.lifecycle import PauseReason
from robotouille.errors import ProtocolError
from robotouille.planning.policies.policy import Speech
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Signal, is_outdated
from robotouille.world.presentation.wording import Wording
from robotouille.world.unmet import only_words
from robotouille.world.world import State
from robotouille_client.bots.partners import Decision, Partners
from robotouille_client.window.sources.blockages import Blockages, TakenStep
from robotouille_client.window.sources.feedback import ChatLog, Feedback
from robotouille_client.window.sources.texts import (
    clock_words,
    outcome_words,
    waiting_words,
    won,
)
from robotouille_client.window.view import GLIDE_SECONDS, GameSource, PauseView, SeatView, View

THINKS_LONG = 0.5
"""Seconds after which a bot is shown as thinking. Shorter would flicker in every step."""


@dataclass(frozen=True, slots=True)
class LocalSeats:
    """Players of a local game.

    Attributes:
        me: Player of the person at the window.
        bots: Names of the bots by player.
        name: Name of the person.
        companion: Player and name of a second person at the window; empty without one.
        agent: Description of the bots for the recording.
    """

    me: str
    bots: Mapping[str, str]
    name: str = "you"
    agent: str = ""
    companion: tuple[str, str] = ("", "")


class LocalSource(GameSource):
    """Episode in this process, with bots in the other seats.

    Bots decide in their own time. Real-time games go on while they think; the steps of other
    games wait for them.

    Args:
        record: Function that receives all events, in order.
    """

    def __init__(
        self,
        episode: Episode,
        seats: LocalSeats,
        partners: Partners,
        now: Callable[[], float],
        *,
        record: Callable[[Iterable[Event]], None] | None = None,
        words: Language = NO_WORDS,
    ) -> None:
        me, bots, name = seats.me, seats.bots, seats.name
        self._episode = episode
        self._me = me
        self._bots = bots
        self._partners = partners
        self._now = now
        self._name = name
        self._companion, companion_name = seats.companion
        self._record = record
        self._wording = Wording(
            episode.world, language_of(episode.world.task).with_words(words), me, bots
        )
        rules = episode.rules
        row, players = rules.model_dump(mode="json"), len(episode.world.players)
        self._clock_words = clock_words(rules.clock.value, row, players)
        self._chat_log = ChatLog(now)
        self._blockages = Blockages(now)
        self._feedback = Feedback(self._chat_log, self._blockages)
        self._previous: State | None = None
        # The episode expects each player's requests to be numbered, as on a server.
        self._seq: dict[str, int] = dict.fromkeys(episode.world.players, 0)
        self._step_time = now()
        self._decided = dict.fromkeys(bots, -1)
        self._asked: dict[str, tuple[int, float]] = {}
        self._answers: dict[str, Decision] = {}
        episode.join(me, name, "human", now())
        if self._companion:
            episode.join(self._companion, companion_name, "human", now())
        for player, bot in bots.items():
            episode.join(player, bot, "bot", now(), agent=seats.agent)
        kinds = {seat.player: seat.controller.value for seat in episode.seats.values()}
        # Planners plan differently with people and in real time, so they must know both first.
        partners.meet(kinds, episode.rules.clock.value)

    def view(self) -> View:
        self._episode.tick(self._now())
        # Bots must know what led to a state before they decide on it. Their decisions can take
        # a step at once, whose events belong in this view.
        self._take_events()
        self._ask_bots()
        self._take_answers()
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
            clock=self._clock_words,
            phase=min(1.0, elapsed / (rules.period if scheduled else GLIDE_SECONDS)),
            step_seconds=rules.period if scheduled else None,
            seats=tuple(
                SeatView(s.player, s.name, s.kind, s.present, s.tally.acted, s.tally.rejected)
                for s in episode.seats.values()
            ),
            me=self._me,
            companion=self._companion or None,
            bubbles=self._chat_log.bubbles,
            chat=self._chat_log.lines,
            status=self._status(),
            outcome=outcome_words(outcome.to_json()) if outcome else "",
            won=outcome is not None and won(outcome.to_json()),
            pause=PauseView("Paused", "Take your time.") if episode.paused else None,
            starts_in=self._starts_in(),
            notice=self._chat_log.notice,
            waits_for=self._waits_for(),
            thinking=self._thinking(),
            blocked=self._blockages.at(episode.state) if episode.running else (),
            seconds=self._now(),
            # The clock of steps ends with the episode.
            since_end=elapsed if episode.ended else None,
        )

    def _status(self) -> str:
        starts_in = self._starts_in()
        if starts_in is not None:
            return waiting_words((), starts_in)
        turn = self._episode.on_turn
        if turn is None:
            return ""
        return "Your turn" if turn == self._me else f"{self._bots.get(turn, turn)}'s turn"

    def _starts_in(self) -> float | None:
        starts_at = self._episode.starts_at
        return None if starts_at is None else max(0.0, starts_at - self._now())

    def _waits_for(self) -> tuple[str, ...]:
        """Return the bots for whose decision the step has been waiting."""
        return tuple(p for p in self._thinking() if p in self._episode.waits_for)

    def _thinking(self) -> tuple[str, ...]:
        """Return the bots that have been deciding for a while."""
        # Most decisions are quicker than this. Showing them all would make the cards flicker.
        since = self._now() - THINKS_LONG
        return tuple(player for player, (_, asked) in self._asked.items() if asked <= since)

    def _show_speech(self, event: ChatPosted) -> None:
        self._feedback.show_speech(event, event.player, self._episode.state, self._wording)
        self._partners.hear(event.player, Speech(event.text, event.signal))

    def _ask_bots(self) -> None:
        """Ask the bots that may act for a decision."""
        episode = self._episode
        # The first plans take longest, so bots start during the countdown.
        if not (episode.running or episode.starts_at is not None):
            return
        for player in self._bots:
            may = episode.on_turn in (None, player) and not episode.state.busy_steps(player)
            if may and player not in self._asked and self._decided[player] < episode.step:
                self._asked[player] = episode.step, self._now()
                self._partners.ask(player, episode.state)

    def _take_answers(self) -> None:
        """Submit the decisions of the bots."""
        episode = self._episode
        if not episode.ended:
            self._answers.update((each.player, each) for each in self._partners.answers())
            for player, speech in self._partners.spoken():
                self._speak(player, speech)
            for text in self._partners.news():
                self._chat_log.add_game_event(text)
        # Answers that arrive during the countdown are kept until the game runs.
        if not episode.running:
            return
        for player in list(self._answers):
            decision, (asked_at, _) = self._answers.pop(player), self._asked.pop(player)
            late, action = asked_at < episode.step, decision.action
            # A late decision still counts if its action is valid: dropping every late one would
            # leave slow planners idle in real time. Otherwise the bot is asked again.
            if not late or (action and episode.world.applicable(episode.state, action)):
                self._decided[player] = episode.step
                self._submit(player, action, waits=decision.waits)

    def _speak(self, player: str, speech: Speech) -> None:
        """Publish or record what a bot says."""
        episode, now = self._episode, self._now()
        if speech.to_bots:
            episode.note(player, TEAM_TOPIC, speech.text, now)
        elif speech.signal is not None:
            # The bot may have decided some steps ago: the item may be gone, or the place free.
            if is_outdated(speech.signal, player, episode.state):
                return
            with suppress(ProtocolError):
                episode.signal(self._bots[player], player, speech.signal, now)
        else:
            episode.say(self._bots[player], player, speech.text, now)

    def _submit(self, player: str, action: GroundAction | None, *, waits: bool = False) -> None:
        self._seq[player] += 1
        try:
            self._episode.submit(
                player, ActionRequest(self._seq[player], action, waits=waits), self._now()
            )
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
                    # Lost races are not reported as rejections, but they show who is in the way.
                    for move, attempt in zip(event.moves, event.attempts, strict=True):
                        self._blockages.refused(move.player, attempt.unmet, event.state)
                    did = [
                        (move.player, move.action, attempt.applied)
                        for move, attempt in zip(event.moves, event.attempts, strict=True)
                    ]
                    step = TakenStep(event.before, event.state, did, event.waits)
                    self._feedback.stepped(step, self._wording)
                    self._partners.observe(did)
                case ActionRejected():
                    why = event.player, event.action, event.unmet
                    self._feedback.show_rejection(*why, self._episode.state, self._wording)
                case ChatPosted():
                    self._show_speech(event)
                case EpisodeEnded():
                    self._step_time = self._now()
                    self._chat_log.ended()
                case _:
                    pass

    def pause(self, paused: bool) -> None:
        """Pause or resume the game's clock, e.g. while the player reads the help."""
        # Without a clock, the game waits for the player anyway.
        if not self._episode.rules.scheduled:
            return
        change = self._episode.pause if paused else self._episode.resume
        change(PauseReason.PLAYER, self._now())

    def act(self, action: GroundAction) -> None:
        player = action.player if action.player in (self._me, self._companion) else None
        self._submit(player or self._me, action)

    def signal(self, signal: Signal) -> None:
        try:
            self._episode.signal(self._name, self._me, signal, self._now())
        except ProtocolError as error:
            self._chat_log.happened(error.message)

    def say(self, text: str) -> None:
        try:
            self._episode.say(self._name, self._me, text, self._now())
        except ProtocolError as error:
            self._chat_log.happened(error.message)

    @property
    def outcome(self) -> dict[str, Any] | None:
        """The outcome, as in recordings; None while the game runs."""
        outcome = self._episode.outcome
        return outcome.to_json() if outcome else None

    @property
    def finished(self) -> bool:
        return self._episode.phase is Phase.ENDED
