"""Words that participants send during an episode: chat, signals and notes."""

from __future__ import annotations

from robotouille.domain.rendering import NO_WORDS, Language, language_of
from robotouille.episode.events import ChatPosted, Noted
from robotouille.episode.quota import NOTE_BYTES, size_of_note
from robotouille.episode.record import EpisodeRecord
from robotouille.episode.rules import Chat
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.world.presentation.signals import Signal, signal_fault, signal_text
from robotouille.world.presentation.wording import Wording


class Speech:
    """Chat, signals and notes of one episode, within the rules and the quotas of the seats."""

    __slots__ = ("_language", "_record")

    def __init__(self, record: EpisodeRecord) -> None:
        self._record = record
        self._language: Language | None = None

    def say(self, name: str, player: str, text: str, now: float) -> None:
        """Post a chat message; see `Episode.say`."""
        self._record.check_open()
        self._check_chat(text)
        self._post(name, player, text, now)

    def signal(self, name: str, player: str, signal: Signal, now: float) -> None:
        """Post a signal with its sentence; see `Episode.signal`."""
        record = self._record
        record.check_open()
        record.seat(player)
        if record.rules.chat not in (Chat.FREE, Chat.SIGNALS):
            code = "chat/off" if record.rules.chat is Chat.OFF else "chat/phrase"
            raise ProtocolError(code, "signals are off in this episode", "intent")
        if fault := signal_fault(signal, player, record.state):
            raise ProtocolError("chat/target", fault, "target")
        self._post(name, player, self._sentence(signal, player), now, signal)

    def note(self, player: str, topic: str, text: str, now: float, *, more: bool) -> None:
        """Record a text of a seat; see `Episode.note`."""
        record = self._record
        record.check_open()
        seat = record.seat(player)
        size = size_of_note(topic, text)
        # Notes may use half of the quota: the rest stays for reasoning and chat, which matter more.
        if seat.quota.reached or not seat.quota.half_left(size):
            raise ProtocolError("rate/words", "no more notes of this seat are recorded", "text")
        seat.quota.take(size)
        record.emit(Noted(player, topic, text, record.elapsed(now), more))

    def _check_chat(self, text: str) -> None:
        rules = self._record.rules
        if rules.chat is Chat.OFF:
            raise ProtocolError("chat/off", "chat is off in this episode", "text")
        if rules.chat is Chat.SIGNALS:
            message = "only signals can be sent in this episode"
            raise ProtocolError("chat/phrase", message, "text")
        # The episode checks this, because a study must be able to rely on it for every client.
        if rules.chat is Chat.PHRASES and text not in rules.phrases:
            listed = ", ".join(map(repr, rules.phrases))
            message = f"only these phrases can be sent in this episode: {listed}"
            raise ProtocolError("chat/phrase", message, "text")

    def _sentence(self, signal: Signal, player: str) -> str:
        world = self._record.world
        if self._language is None:
            try:
                self._language = language_of(world.task)
            except RobotouilleError:  # The rendering is gone, or has got faults.
                self._language = NO_WORDS
        # Without the names of participants: exports without names keep this text.
        # The sentence must not show the sender, or others, more than the sender sees.
        seen = self._record.seen_state(player)
        return signal_text(signal, seen, Wording(world, self._language))

    def _post(
        self, name: str, player: str, text: str, now: float, signal: Signal | None = None
    ) -> None:
        record = self._record
        # Spectators share one quota, because the task limits the number of seats, but not the
        # number of spectators.
        quota = record.seat(player).quota if player else record.audience_quota
        size = NOTE_BYTES + len(name.encode()) + len(text.encode())
        record.take_quota(quota, size, player, now, "you cannot chat here any more")
        if player:
            record.seat(player).tally.said += 1
        record.said += 1
        intent, target = signal or ("", "")
        time = record.elapsed(now)
        record.emit(ChatPosted(name, player, text, time, record.said, str(intent), target))
