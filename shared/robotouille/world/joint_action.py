"""What a caller may give as a joint action, and in which order it is carried out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from robotouille.errors import UnknownNameError, WrongArgumentError, WrongWorldError, did_you_mean
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.ground_task import GroundTask

__all__ = ["JointAction", "in_order", "not_an_action", "read"]

ActionLike = GroundAction | str | None
"""One player's action, the sentence of a valid one, or nothing."""

JointAction = ActionLike | Sequence[ActionLike] | Mapping[str, ActionLike]
"""One action, several in the order in which they apply, or one for each player."""

_EXPECTED = (
    "expected an action (`state.actions(player)` lists the valid ones), its sentence, None for "
    "nothing, a list of these, or a dict of them by player"
)


def in_order(
    joint: JointAction, players: Sequence[str]
) -> Iterator[tuple[str | None, GroundAction | str]]:
    """What is wanted in a step, with the player where it is said by whom; nothing is left out."""
    if isinstance(joint, GroundAction | str):
        yield None, joint
    elif isinstance(joint, Mapping):
        for player, action in joint.items():
            if player not in players:
                raise UnknownNameError(f"no player {player!r}{did_you_mean(player, players)}")
            if action is not None:
                yield player, action
    elif isinstance(joint, Iterable):
        for action in joint:
            if action is not None:
                yield None, action
    elif joint is not None:
        raise WrongArgumentError(f"{_EXPECTED}; found {joint!r}")


def read(action: object, task: GroundTask, said: Callable[[str], GroundAction]) -> GroundAction:
    """The action of a task that is meant by a sentence, or by an action of another world."""
    if isinstance(action, GroundAction):
        return _own(action, task)
    if isinstance(action, str):
        return said(action)
    raise WrongArgumentError(f"{_EXPECTED}; found {action!r}")


def not_an_action(found: object) -> WrongArgumentError:
    """What to raise where an action of the world is needed, and nothing else will do."""
    return WrongArgumentError(
        f"expected an action, as world.action(name, *arguments) gives, found {found!r}"
    )


def _own(action: GroundAction, task: GroundTask) -> GroundAction:
    other = action.source.task
    if other.digest != task.task.digest:
        raise WrongWorldError(
            f"{action} is an action of another task, {other.name}; "
            f"ask this world: world.action({action.name!r}, *arguments)"
        )
    task.admit(action.arguments)
    return task.action(action.name, *action.arguments)
