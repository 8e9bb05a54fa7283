"""Episodes, most of them with all seats taken, for tests of what happens in them."""

from __future__ import annotations

from robotouille import GroundAction, World
from robotouille.episode import Clock, Episode, Reason, Rules, Stepped

ONE = World("synchronous/01")
TWO = World("multi_agent/01")


def opened(**rules: object) -> Episode:
    """A kitchen for two in real time, which people are counted down to and nobody has joined."""
    options = {"clock": Clock.REALTIME, "step_rate": 10.0, "grace": 30.0, "countdown": 3.0, **rules}
    return Episode(TWO, Rules(**options))  # type: ignore[arg-type]


def start(world: World = TWO, now: float = 0.0, kind: str = "bot", **rules: object) -> Episode:
    """A game that has just begun; its events so far are forgotten."""
    episode = Episode(world, Rules(**rules), now)  # type: ignore[arg-type]
    for player in world.players:
        episode.join(player, player.upper(), kind, now, session=f"s-{player}")
    episode.events()
    return episode


def steps(episode: Episode) -> list[Stepped]:
    """The steps since events were last asked for."""
    return [event for event in episode.events() if isinstance(event, Stepped)]


def first(episode: Episode, player: str, name: str = "move") -> GroundAction:
    """A player's first valid action of this name."""
    return next(action for action in episode.state.actions(player) if action.name == name)


def outcome(episode: Episode) -> tuple[Reason, str]:
    """How it ended, with the detail."""
    assert episode.outcome is not None
    return episode.outcome.reason, episode.outcome.detail
