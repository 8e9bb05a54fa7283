"""Write the table in docs/packs.md that compares the shipped pack with the published one.

    python tools/pack_differences.py CHECKOUT [PROBLEMS…]

CHECKOUT is a checkout of the published repository. PROBLEMS are folders with problems
(`multi_agent/…`) that the checkout lacks.
"""

from __future__ import annotations

import argparse
import re
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from robotouille_evaluation.packs.differences import compare_packs, markdown_tables
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.published_checkout import DATASETS, PROBLEMS, read_checkout

PAGE = Path(__file__).resolve().parents[1] / "docs/packs.md"
PART = re.compile(r"(<!-- begin generated: pack differences -->\n).*?(<!-- end)", re.DOTALL)


def table(checkout: Path, *more: Path) -> str:
    """Return the table of the tasks that both packs have."""
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name) / "checkout"
        shutil.copytree(checkout, whole)
        for folder in more:
            for dataset in DATASETS:
                if (folder / dataset).is_dir():
                    target = whole / PROBLEMS / dataset
                    shutil.copytree(folder / dataset, target, dirs_exist_ok=True)
        published = read_checkout(whole, seeds=[]).pack
    found = compare_packs(build_own_pack(), published)
    tasks = tuple(task for task in found.tasks if task.a is not None and task.b is not None)
    return markdown_tables(replace(found, overall=(), wording=(), tasks=tasks))


def page(text: str, checkout: Path, *more: Path) -> str:
    """Return the page with an updated table."""
    new = f"\n{table(checkout, *more)}\n"
    return PART.sub(lambda match: f"{match[1]}{new}{match[2]}", text)


def main(arguments: Sequence[str] | None = None) -> None:
    """Update the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("checkout", type=Path, metavar="CHECKOUT")
    parser.add_argument("problems", type=Path, nargs="*", metavar="PROBLEMS")
    options = parser.parse_args(arguments)
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(page(text, options.checkout, *options.problems), encoding="utf-8")


if __name__ == "__main__":
    main()
