"""The instances of the paper's datasets: ten of each task (section 3, "Dataset Details").

Those are free; five noisy ones of each task are a split of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from robotouille.domain.loading import load_task, task_names
from robotouille.generation.generator import Generator
from robotouille.generation.instance import Instance
from robotouille.generation.parameters import DEFAULT, Kind, Parameters
from robotouille.generation.proof import Solver, shortest

__all__ = ["SEEDS", "generate_dataset", "kind_at", "paper_tasks", "seeds_from"]

FOLDERS = ("synchronous", "asynchronous", "multi_agent")


def seeds_from(first: int, count: int) -> tuple[int, ...]:
    """The seeds of a row of instances: multiples of the first, as in the paper's datasets."""
    return tuple(first * position for position in range(1, count + 1))


SEEDS = seeds_from(42, 15)
"""42, 84 and so on to 630. The paper's instances have the first ten; ours are other kitchens."""

LAST_NOISY = 10
"""The position of the last noisy instance: ten of fifteen are free."""


def paper_tasks() -> tuple[str, ...]:
    """The thirty tasks of the paper."""
    names = [name for name in task_names() if name.count("/") == 1]
    return tuple(n for folder in FOLDERS for n in names if n.startswith(f"{folder}/"))


def kind_at(position: int) -> Kind:
    """The kind of a task's instance by its position, from 1.

    Free ones and noisy ones in turn up to the tenth, free ones behind it.
    """
    return Kind.NOISY if position % 2 == 0 and position <= LAST_NOISY else Kind.FREE


def generate_dataset(
    tasks: Iterable[str] | None = None,
    seeds: Iterable[int] = SEEDS,
    parameters: Parameters = DEFAULT,
    *,
    solver: Solver = shortest,
) -> Iterator[Instance]:
    """The instances of tasks (the paper's if None), task by task, in the order of the seeds.

    Args:
        tasks: Names or paths for `load_task`.

    Raises:
        UnknownTaskError: There is no such task.
        FileError: A task has faults.
        GenerationError: A seed gives no instance; `parameter` names what to ask for instead.
    """
    row = tuple(seeds)
    for name in paper_tasks() if tasks is None else tasks:
        task = load_task(name)
        generators = {kind: Generator(task, kind, parameters, solver=solver) for kind in Kind}
        for position, seed in enumerate(row, start=1):
            yield generators[kind_at(position)].instance(seed)
