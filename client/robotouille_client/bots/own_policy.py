"""`robotouille-bot MODULE:NAME`: a policy of the user's own.

It is imported from the current folder, or from what is installed, which comes first. Whoever starts
the program names it: nothing that comes from a server is ever imported.
"""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotouille.errors import RobotouilleError, did_you_mean

if TYPE_CHECKING:
    from robotouille.planning.policies.policy import Policy
    from robotouille.world.world import State
    from robotouille_client.bots.player import MakePolicy

__all__ = ["own_policy_maker"]

WHAT_IT_IS = "a class or function that takes (state, player) and gives a policy"


def own_policy_maker(name: str) -> MakePolicy:
    """How to make the policy `MODULE:NAME`; RobotouilleError says what is missing."""
    module_name, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module_name.split("."), attribute)):
        raise RobotouilleError(f"{name!r} is not MODULE:NAME, as in my_bot:MyPolicy")
    module = _import(module_name)
    if not hasattr(module, attribute):
        known = [n for n in vars(module) if not n.startswith("_")]
        near = did_you_mean(attribute, known)
        raise RobotouilleError(
            f"{getattr(module, '__file__', None) or module_name} has no {attribute!r}{near}"
        )
    maker = getattr(module, attribute)
    if not _takes_two(maker):
        raise RobotouilleError(f"{name} has to be {WHAT_IT_IS}")

    def make(state: State, player: str) -> Policy:
        policy: Policy = maker(state, player)
        for method in ("act", "observe"):
            if not callable(getattr(policy, method, None)):
                hint = "; derive the class from robotouille_client.bots.Policy"
                raise RobotouilleError(f"what {name} gives has no method {method!r}{hint}")
        return policy

    return make


def _import(name: str) -> Any:
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)  # Last: no file of the folder takes the place of a library.
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(f"{error.name}.")):
            file = f"{name.replace('.', '/')}.py"
            raise RobotouilleError(
                f"there is no {file} in {folder}, nor a package {name}"
            ) from None
        raise RobotouilleError(f"{name} needs {error.name!r}, which is not installed") from error
    except Exception as error:
        message = f"{name} cannot be imported: {type(error).__name__}: {error}"
        raise RobotouilleError(message) from error


def _takes_two(maker: Any) -> bool:
    try:
        inspect.signature(maker).bind(None, "")
    except (TypeError, ValueError):
        return False
    return True
