"""Write the shipped instances of the paper's tasks (docs/planners.md).

    python tools/generate_dataset.py                   all tasks, to problems/generated
    python tools/generate_dataset.py FOLDER            all tasks, to another folder
    python tools/generate_dataset.py FOLDER TASK…      some tasks: asynchronous/06_potato_soup

Generates ten free and five noisy instances of each of the thirty tasks. The files are the same on
every machine. `robotouille certify problems/generated` writes their certificates.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.progress import track

from robotouille.generation.generator import generate_dataset, paper_tasks

FOLDER = Path(__file__).resolve().parents[1] / "problems" / "generated"


def write(task: str, folder: Path) -> None:
    """Write the instances of one task."""
    target = folder / task.partition("/")[0]
    target.mkdir(parents=True, exist_ok=True)
    for instance in generate_dataset([task]):
        path = target / f"{instance.name.rpartition('/')[2]}.json"
        path.write_text(instance.text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the instances of all named tasks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=FOLDER, metavar="FOLDER")
    parser.add_argument("tasks", nargs="*", metavar="TASK")
    options = parser.parse_args(arguments)
    folder, tasks = options.folder, options.tasks or paper_tasks()
    if strange := sorted({*tasks} - {*paper_tasks()}):
        raise SystemExit(f"unknown tasks of the paper: {', '.join(strange)}")
    with ProcessPoolExecutor() as pool:
        for _ in track(pool.map(write, tasks, [folder] * len(tasks)), total=len(tasks)):
            pass


if __name__ == "__main__":
    main()
