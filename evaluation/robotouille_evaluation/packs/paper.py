"""Built-in pack `paper`: the shipped tasks, with instances drawn as those of the paper.

The instances come from the published generator (`published_layouts`), which shuffles objects on the
grid of the problem and adds others. Its draws depend on that grid and on the stations, and those of
the shipped tasks are larger. So each task first gets a grid and a number of tables like those of
the published files, and then a layout for each of the published seeds.

Tasks for teams are left out, because the published generator keeps one player only.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache, partial
from importlib.resources import files
from typing import Any

from robotouille.domain.json_files import read_json
from robotouille.domain.task import read_domain
from robotouille.generation.generator import paper_tasks
from robotouille.installation import data_folder
from robotouille_evaluation.packs.own import (
    DOMAINS,
    NAME,
    Progress,
    built_once,
    canonical_domain,
    instance_id,
    own_examples,
    own_prompts,
)
from robotouille_evaluation.packs.pack import (
    KnownPlan,
    Pack,
    PackInstance,
    PackTask,
    canonical_json,
)
from robotouille_evaluation.packs.published_checkout import SEEDS
from robotouille_evaluation.packs.published_layouts import generate_layout

PAPER = "paper"
VERSION = "1"
DATASETS = ("synchronous", "asynchronous")
PLANS = "paper_plans.json"

SIDE, SIDE_OF_SOUPS = 5, 6
"""Sides of the square grids of published tasks, without and with containers."""

MAX_TABLES = 8
"""Most tables of a published task; others have about as many as items and containers."""


def build_paper_pack(progress: Progress | None = None) -> Pack:
    """Return the built-in pack of instances drawn as in the paper, built once per process.

    Raises:
        FileError: A shipped file is invalid.
    """
    return built_once(PAPER, partial(_build, progress))


def _build(progress: Progress | None) -> Pack:
    names = [name for name in paper_tasks() if name.partition("/")[0] in DATASETS]
    tasks: list[PackTask] = []
    instances: list[PackInstance] = []
    for number, name in enumerate(names, start=1):
        raw = read_json(data_folder("problems") / f"{name}.json")
        # The constant of a task is that of its default layout, which this pack does not have.
        tasks.append(PackTask(name, name.partition("/")[0], canonical_json(raw), None, ""))
        instances += _instances(name, published_proportions(raw))
        if progress is not None:
            progress(number, len(names))
    domain = read_domain(DOMAINS[NAME])
    return Pack(
        PAPER,
        VERSION,
        canonical_domain(domain),
        tuple(tasks),
        tuple(instances),
        own_prompts(domain),
        own_examples(*DATASETS),
    )


def _instances(task: str, source: dict[str, Any]) -> Iterator[PackInstance]:
    for seed in SEEDS:
        layout = generate_layout(source, seed, source=task)
        id_ = instance_id(task, "free", seed)
        plan = tuple(_plans().get(id_, ()))
        known = (KnownPlan(1, plan, len(plan)),) if plan else ()
        problem = canonical_json(layout.problem)
        yield PackInstance(id_, task, "free", seed, layout.seed_used, problem, plans=known)


def published_proportions(problem: dict[str, Any]) -> dict[str, Any]:
    """Return a problem with the grid and the number of tables of a published task.

    The cells of its objects may lie outside that grid: a layout replaces them.
    """
    containers = problem.get("containers", [])
    side = SIDE_OF_SOUPS if containers else SIDE
    tables = [each for each in problem["stations"] if each["name"] == "table"]
    kept = tables[: min(MAX_TABLES, len(problem["items"]) + len(containers))]
    others = [each for each in problem["stations"] if each["name"] != "table"]
    smaller = {**problem, "width": side, "height": side, "stations": [*kept, *others]}
    smaller.pop("ground", None)  # It describes the floor of the larger grid.
    return smaller


@cache
def _plans() -> dict[str, list[str]]:
    """Return the proven shortest plans by instance (`tools/prove_paper_pack.py`)."""
    path = files(__package__) / PLANS
    found: dict[str, list[str]] = json.loads(path.read_text(encoding="utf-8"))
    return found
