"""What those in one episode are called."""

from __future__ import annotations

from collections import Counter

from robotouille.episode import Episode
from robotouille.protocol.participant_names import distinct_name, likeness

__all__ = ["DisplayNames"]

MANY = 200


class DisplayNames:
    """Makes names that nobody else in an episode has, whether they play or watch, and are there
    or away. The seats know their own names, from the recording, too."""

    __slots__ = ("_alike", "_episode", "_watching")

    def __init__(self, episode: Episode) -> None:
        self._episode = episode
        self._watching: set[str] = set()
        self._alike: Counter[str] = Counter()

    def choose(self, name: str) -> str:
        """This name, or where somebody has it already, with a number."""
        seats = self._episode.seats.values()
        seated = {likeness(seat.name) for seat in seats if seat.taken}
        like, alike = likeness(name), self._alike
        alike[like] += 1
        if len(alike) > MANY:
            alike.clear()
        # Among thousands of the same name the first free number would be looked for at length.
        first = alike[like] if alike[like] > MANY else 2
        return distinct_name(name, lambda like: like in seated or like in self._watching, first)

    def watch(self, name: str) -> None:
        """A spectator has this name from now on."""
        self._watching.add(likeness(name))

    def release(self, name: str) -> None:
        """A spectator is gone."""
        self._watching.discard(likeness(name))
