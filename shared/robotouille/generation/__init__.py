"""Generation of new, provably solvable instances of a task from a seed.

Generation is deterministic: equal tasks, seeds and parameters give equal files on every machine.
See docs/planners.md.
"""

from robotouille.generation.generator import (
    SEEDS,
    Generator,
    Solver,
    generate_dataset,
    paper_tasks,
    seeds_from,
    shortest,
)
from robotouille.generation.instance import Instance, Renaming
from robotouille.generation.parameters import AttemptError, GenerationError, Kind, Parameters
from robotouille.generation.shifts import ShiftGenerator, generate, generator_of

__all__ = [
    "SEEDS",
    "AttemptError",
    "GenerationError",
    "Generator",
    "Instance",
    "Kind",
    "Parameters",
    "Renaming",
    "ShiftGenerator",
    "Solver",
    "generate",
    "generate_dataset",
    "generator_of",
    "paper_tasks",
    "seeds_from",
    "shortest",
]
