"""What tasks are called in menus and beside kitchens."""

from __future__ import annotations

from functools import lru_cache

from robotouille.domain.loading import load_task, task_names
from robotouille.errors import RobotouilleError

__all__ = ["dish_title", "family_title", "task_title"]


def task_title(name: str) -> str:
    """`multi_agent/01_lettuce_burger` as `Multi agent 01: lettuce burger`."""
    folder, file, variant = _parts(name)
    number, _, dish = file.partition("_")
    words = _goal(name) if _says_nothing(dish) else dish
    title = f"{folder} {number}: {words}".replace("_", " ").strip(" :").capitalize()
    return f"{title}, {variant}" if variant else title


def dish_title(name: str, goal: str) -> str:
    """`Lettuce burger`; of a file that is called after a family of tasks, the goal."""
    file = name.rpartition("/")[2]
    number, _, words = file.partition("_")
    dish = words if number.isdigit() and words else file
    return goal.rstrip(".") if _says_nothing(dish) else dish.replace("_", " ").capitalize()


def family_title(name: str) -> str:
    """`multi_agent/01_lettuce_burger` as `Multi agent`."""
    return name.rpartition("/")[0].replace("_", " ").capitalize()


def _parts(name: str) -> tuple[str, str, str]:
    """`multi_agent`, `06_soup`, `free-42` of `multi_agent/06_soup/free-42`."""
    parts = name.split("/")
    numbered = (i for i, part in enumerate(parts) if part.partition("_")[0].isdigit())
    at = next(numbered, len(parts) - 1)
    return "/".join(parts[:at]), parts[at], "/".join(parts[at + 1 :])


def _says_nothing(dish: str) -> bool:
    """Whether a dish is called after a family of tasks, as in `training/01_synchronous`."""
    return any(name.startswith(f"{dish}/") for name in task_names())


@lru_cache(maxsize=64)
def _goal(name: str) -> str:
    try:
        return load_task(name).goal_description.rstrip(".")
    except (RobotouilleError, OSError):
        return ""
