"""Packs to evaluate on: tasks, instances, step budgets, prompts and examples.

pack = build_own_pack()                                  # the shipped tasks with goals
pack = build_shift_pack()                                # the shipped shifts
pack = read_checkout(Path("robotouille")).pack           # the published ones, from a checkout
write_pack(pack, Path("packs/published"))
"""

from robotouille_evaluation.packs.budget import Budget, BudgetKind, own_budget, published_budget
from robotouille_evaluation.packs.checking import check_pack
from robotouille_evaluation.packs.differences import PackDifferences, compare_packs
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.own import build_own_pack, build_shift_pack
from robotouille_evaluation.packs.pack import (
    ExampleEpisode,
    Examples,
    ExampleStep,
    FigureData,
    InstanceKind,
    KnownPlan,
    Pack,
    PackInstance,
    PackTask,
    Prompt,
)
from robotouille_evaluation.packs.store import default_folder, read_pack, write_pack

__all__ = [
    "Budget",
    "BudgetKind",
    "ExampleEpisode",
    "ExampleStep",
    "Examples",
    "Experiment",
    "FigureData",
    "InstanceKind",
    "KnownPlan",
    "Pack",
    "PackDifferences",
    "PackInstance",
    "PackTask",
    "Prompt",
    "build_own_pack",
    "build_shift_pack",
    "check_pack",
    "compare_packs",
    "default_folder",
    "own_budget",
    "published_budget",
    "read_pack",
    "write_pack",
]
