"""The participants with whom a planner bot plays: its team, and all others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from robotouille.planning.policies.plan_watch import Teammates


class Company:
    """The team of a seat, and the participants outside of it.

    A team consists of planner bots of the same version, which all make the same plans. Until a
    participant turns out to be something else, a seat counts on it.

    Args:
        alone: True to leave all other seats out of the team.
    """

    def __init__(self, player: str, players: Sequence[str], *, alone: bool) -> None:
        self._player = player
        self._players = players
        self._unlike: set[str] = set()
        self._kinds: Mapping[str, str] = {}
        self.team = {player} if alone else set(players)

    @property
    def outsiders(self) -> list[str]:
        """The players outside the team, in seat order."""
        return [player for player in self._players if player not in self.team]

    @property
    def spokesman(self) -> bool:
        """True if the seat speaks for its team, which sends each request once."""
        return self._player == min(self.team)

    def teammates(self, *, hurried: bool) -> Teammates:
        """Return the team and the others, for the check of a plan."""
        others = self.outsiders
        among_bots = any(self._may_be_bot(player) for player in others)
        return Teammates(self.team, others, among_bots=among_bots, hurried=hurried)

    def has_bots(self) -> bool:
        """Return whether another participant is a bot, as far as the seat knows."""
        others = (player for player in self._players if player != self._player)
        return any(self._kinds.get(player, "bot") == "bot" for player in others)

    def has_listeners(self) -> bool:
        """Return whether a participant outside the team reads chat messages."""
        return any(self._kinds.get(p) in ("human", "model", "bot") for p in self.outsiders)

    def meet(self, kinds: Mapping[str, str]) -> bool:
        """Set the kinds of participants, and return whether one has left the team.

        Only bots can be in the team.
        """
        before, self._kinds = self._kinds, dict(kinds)
        left = False
        for player, kind in kinds.items():
            if player == self._player or kind == before.get(player, "bot"):
                continue
            self._unlike.discard(player)
            if kind == "bot":
                self.team.add(player)
            elif kind:
                left = self.leave_out({player}) or left
        return left

    def add_alike(self, player: str) -> None:
        """Add a bot of the same version to the team, and all who may be bots."""
        self._unlike.discard(player)
        self.team |= {p for p in self._players if p not in self._unlike and self._may_be_bot(p)}

    def leave_out_unlike(self, player: str) -> bool:
        """Leave a bot of another version out, and return whether it was in the team."""
        self._unlike.add(player)
        return self.leave_out({player})

    def leave_out(self, players: Collection[str]) -> bool:
        """Stop counting on some players, and return whether one was in the team."""
        left = self.team & {*players} - {self._player}
        self.team -= left
        return bool(left)

    def _may_be_bot(self, player: str) -> bool:
        return self._kinds.get(player, "bot") in ("bot", "")
