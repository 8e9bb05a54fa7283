"""New instances of a task from a seed: shuffled, with irrelevant things added, proven solvable.

Pure and deterministic: the same task, seed and parameters give the same file, byte for byte, on
every machine. See docs/generation.md.
"""

from robotouille.generation.generator import Generator, generate
from robotouille.generation.instance import Instance
from robotouille.generation.paper_instances import SEEDS, generate_dataset, paper_tasks, seeds_from
from robotouille.generation.parameters import AttemptError, GenerationError, Kind, Parameters
from robotouille.generation.proof import Solver, shortest
from robotouille.generation.renaming import Renaming

__all__ = [
    "SEEDS",
    "AttemptError",
    "GenerationError",
    "Generator",
    "Instance",
    "Kind",
    "Parameters",
    "Renaming",
    "Solver",
    "generate",
    "generate_dataset",
    "paper_tasks",
    "seeds_from",
    "shortest",
]
