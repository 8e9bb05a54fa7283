"""Policies of the user's own: `robotouille-bot MODULE:NAME`.

The module is imported from the installed packages or the current folder. Only the user who starts
the program can name it; nothing that a server sends is ever imported.
"""

from __future__ import annotations

import difflib
import importlib
import inspect
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.text import plain

if TYPE_CHECKING:
    from robotouille.planning.policies.policy import Did, Policy
    from robotouille.world.world import State
    from robotouille_client.bots.seat_policy import MakePolicy

WHAT_IT_IS = "a class or function that takes (state, player) and returns a policy"
MAX_FRAMES = 5
"""Maximum number of frames of the user's file that are shown for an exception."""
MAX_QUOTED = 200
"""Maximum number of characters of an invalid action that are shown."""


class OwnPolicyError(RobotouilleError):
    """A policy of the user's own raised, or returned an invalid action.

    Attributes:
        frames: The frames of the user's file, formatted like a traceback; empty if it did not
            raise.
    """

    def __init__(self, message: str, frames: str = "") -> None:
        self.frames = frames
        super().__init__(message)


def load_own(name: str) -> tuple[Any, str]:
    """Return the object `MODULE:NAME` and the file of its module.

    Raises:
        RobotouilleError: The module or name is missing.
    """
    module_name, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module_name.split("."), attribute)):
        raise RobotouilleError(f"{name!r} is not MODULE:NAME, as in my_bot:MyPolicy")
    module = _import(module_name)
    file = getattr(module, "__file__", None) or ""
    if not hasattr(module, attribute):
        known = [n for n in vars(module) if not n.startswith("_")]
        near = did_you_mean(attribute, known)
        raise RobotouilleError(f"{file or module_name} has no {attribute!r}{near}")
    return getattr(module, attribute), file


def own_policy_maker(name: str) -> MakePolicy:
    """Return a function that makes the policy `MODULE:NAME`.

    Raises:
        RobotouilleError: The module or name is missing or is not a policy maker.
    """
    maker, file = load_own(name)
    if not _takes_two(maker):
        raise RobotouilleError(f"{name} must be {WHAT_IT_IS}")
    if inspect.isclass(maker) and not callable(getattr(maker, "act", None)):
        raise RobotouilleError(
            f"{name} has no method 'act', which takes a state and returns an action"
        )

    def make(state: State, player: str) -> Policy:
        with own_errors(name, file):
            policy = maker(state, player)
        if not callable(getattr(policy, "act", None)):
            raise OwnPolicyError(f"the policy that {name} returns has no method 'act'")
        return _OwnPolicy(policy, player, name, file)

    return make


class _OwnPolicy:
    """Adapter of a user's policy, which may lack `observe` and may return sentences."""

    def __init__(self, policy: Any, player: str, name: str, file: str) -> None:
        self._policy = policy
        self._player = player
        self._name = name
        self._file = file

    def observe(self, did: Did) -> None:
        observe = getattr(self._policy, "observe", None)
        if observe is not None:
            with own_errors(f"{self._name}.observe", self._file):
                observe(did)

    def act(self, state: State) -> GroundAction | None:
        with own_errors(f"{self._name}.act", self._file):
            found = self._policy.act(state)
        if found is None or isinstance(found, GroundAction):
            return found
        if not isinstance(found, str):
            why = "expected an action, its sentence or None"
        else:
            try:
                action = state.world.parse(state, self._player, found, valid=False)
            except UnknownNameError:
                why = f"nearest: {_nearest(found, state.actions(self._player))}"
            else:
                unmet = [each.words for each in state.world.unmet(state, action)]
                if not unmet and action.player == self._player:
                    return action
                why = "; ".join(unmet) or f"it is an action of {action.player}"
        quoted = repr(found)
        cut = quoted if len(quoted) <= MAX_QUOTED else f"{quoted[:MAX_QUOTED]}…"
        raise OwnPolicyError(
            f"{self._name}.act returned {cut}, which is not a valid action ({why})"
        )


def _nearest(text: str, actions: tuple[GroundAction, ...]) -> str:
    sentences = {plain(action.sentence): action.sentence for action in actions}
    near = difflib.get_close_matches(plain(text[:MAX_QUOTED]), sentences, n=2, cutoff=0)
    return " or ".join(repr(sentences[each]) for each in near) or "no action is valid now"


@contextmanager
def own_errors(what: str, file: str) -> Iterator[None]:
    """Turn an exception of the user's code into an `OwnPolicyError` with frames of its file."""
    try:
        yield
    except Exception as error:
        raise own_error(what, file, error) from error


def own_error(what: str, file: str, error: Exception) -> OwnPolicyError:
    """Return an exception of the user's code as an `OwnPolicyError`."""
    own = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    frames = "".join(traceback.format_list(own[-MAX_FRAMES:])).rstrip()
    words = f"{type(error).__name__}: {error}".rstrip(": ")
    return OwnPolicyError(f"{what} raised {words}", frames)


def _import(name: str) -> Any:
    folder = str(Path.cwd())
    if folder not in sys.path:
        # Last, so that no file of the folder replaces a library.
        sys.path.append(folder)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(f"{error.name}.")):
            if name.endswith(".py"):
                module = name.removesuffix(".py")
                message = f"{name} is a file; give its module, without .py, as in {module}:NAME"
                raise RobotouilleError(message) from None
            file = f"{name.replace('.', '/')}.py"
            raise RobotouilleError(
                f"no {file} in {folder}, and no installed package {name}"
            ) from None
        raise RobotouilleError(f"{name} needs {error.name!r}, which is not installed") from error
    except (Exception, SystemExit) as error:  # A script may call `sys.exit`.
        message = f"{name} cannot be imported: {type(error).__name__}: {error}"
        raise RobotouilleError(message) from error


def _takes_two(maker: Any) -> bool:
    try:
        inspect.signature(maker).bind(None, "")
    except (TypeError, ValueError):
        return False
    return True
