"""What an `act` message asks for, as an action of the world."""

from __future__ import annotations

from robotouille.episode import Episode
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction

__all__ = ["ground", "in_words"]


def ground(episode: Episode, player: str, request: messages.Act) -> GroundAction | None:
    """The action, valid at present or not; None for nothing.

    ProtocolError `action/unknown` if there is no such action, `action/stale` for a position in the
    list of another step.
    """
    wanted, state = request.action, episode.state
    if wanted is None:
        return None
    if isinstance(wanted, int):
        return _at(episode, player, wanted, request.basis)
    try:
        if isinstance(wanted, str):
            return episode.world.parse(state, player, wanted)
        return episode.world.action(wanted.name, *wanted.args)
    except KeyError as error:
        raise ProtocolError("action/unknown", str(error.args[0]), "action") from None


def _at(episode: Episode, player: str, position: int, basis: int | None) -> GroundAction:
    if basis != episode.step:
        message = f"step {basis} is past; it is step {episode.step}"
        raise ProtocolError("action/stale", message, "basis")
    actions = episode.state.actions(player)
    if position >= len(actions):
        message = f"there are {len(actions)} valid actions, found {position}"
        raise ProtocolError("action/unknown", message, "action")
    return actions[position]


def in_words(request: messages.Act) -> str:
    """The request as it was written."""
    wanted = request.action
    if isinstance(wanted, messages.NamedAction):
        return f"{wanted.name}({', '.join(wanted.args)})"
    return "nothing" if wanted is None else str(wanted)
