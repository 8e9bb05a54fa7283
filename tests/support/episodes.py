"""Episodes for unit tests, most of them with all seats taken."""

from __future__ import annotations

from robotouille import GroundAction, World
from robotouille.episode import Clock, Episode, Reason, Rules, Stepped

ONE = World("synchronous/01")
TWO = World("multi_agent/01")


def opened(**rules: object) -> Episode:
    """Return a real-time episode for two with a countdown and no participants."""
    options = {"clock": Clock.REALTIME, "step_rate": 10.0, "grace": 30.0, "countdown": 3.0, **rules}
    return Episode(TWO, Rules(**options))  # type: ignore[arg-type]


def start(world: World = TWO, now: float = 0.0, kind: str = "bot", **rules: object) -> Episode:
    """Return an episode that has just started, with its events so far discarded."""
    episode = Episode(world, Rules(**rules), now)  # type: ignore[arg-type]
    for player in world.players:
        episode.join(player, player.upper(), kind, now, session=f"s-{player}")
    episode.events()
    return episode


def steps(episode: Episode) -> list[Stepped]:
    """Return the steps since the last call of `events`."""
    return [event for event in episode.events() if isinstance(event, Stepped)]


def first(episode: Episode, player: str, name: str = "move") -> GroundAction:
    """Return a player's first valid action with this name."""
    return next(action for action in episode.state.actions(player) if action.name == name)


def outcome(episode: Episode) -> tuple[Reason, str]:
    """Return how the episode ended, with the detail."""
    assert episode.outcome is not None
    return episode.outcome.reason, episode.outcome.detail
