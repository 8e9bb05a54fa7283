"""The plan that lies beside a problem file."""

from __future__ import annotations

from pathlib import Path

from robotouille.domain.files import is_file
from robotouille.errors import FileError
from robotouille.planning.plan import Plan, read_plan
from robotouille.planning.validation import replay
from robotouille.world.world import World

__all__ = ["plan_beside"]


def plan_beside(world: World) -> Plan | None:
    """The plan in the file beside a world's problem file, if there is one and it works."""
    source = Path(world.task.source)
    for name in (f"{source.stem}@{world.task.seats}.plan", f"{source.stem}.plan"):
        path = source.parent / name
        if not is_file(path):
            continue
        try:
            steps = _without_comments(path.read_text(encoding="utf-8"))
            plan = read_plan(steps, world, str(path))
        except (OSError, UnicodeDecodeError, FileError):
            continue
        if replay(plan, world).ok:
            return plan
    return None


def _without_comments(text: str) -> str:
    """A plan's steps alone: its header may name the task otherwise than by its file."""
    return "\n".join(line for line in text.splitlines() if not line.startswith("#"))
