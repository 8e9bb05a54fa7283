"""Write the tables of docs/plan_lengths.md.

    python tools/generate_docs.py            writes the tables that come from certificates
    python tools/plan_lengths.py FOLDER      prints the section on the published layouts

FOLDER contains the published problem files, in `synchronous`, `asynchronous` and `multi_agent`.
They are not shipped. The second command takes a few minutes with the extra `fast`.
"""

from __future__ import annotations

import argparse
import re
import statistics
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from robotouille import load_task
from robotouille.certification.certificate import Certificate, certify, read_certificate
from robotouille.certification.certifying import BUDGET
from robotouille.planning.solvers import solve

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
FOLDERS = ("synchronous", "asynchronous", "multi_agent")
PAPER = {
    "synchronous": (10, 14, 24, 10, 15, 23, 36, 44, 63, 57),
    "asynchronous": (21, 27, 37, 42, 46, 19, 42, 46, 68, 82),
}
"""Column "Horizon Length" of the paper's table of success rates by task."""


def of_paper(folder: str, number: int) -> str:
    """Return the paper's number of steps for a task, counted from 1, or a dash for teams."""
    return str(PAPER[folder][number - 1]) if folder in PAPER else "–"


def certificates(folder: Path) -> Iterator[Certificate]:
    for path in sorted(folder.glob("*.certificate.json")):
        yield read_certificate(path)


def table(heads: Iterable[str], rows: Iterable[Iterable[object]], words: int = 1) -> str:
    """Format a table: `words` left-aligned columns, then right-aligned numbers."""
    heads = list(heads)
    marks = ["---"] * words + ["---:"] * (len(heads) - words)
    lines = [heads, marks, *([str(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def claim(found: Certificate) -> tuple[object, ...]:
    """Return players, steps, bound, whether the length is proven, and expansions."""
    length = "–" if found.length is None else found.length
    return (
        found.seats,
        length,
        found.bound,
        "yes" if found.optimal else "no",
        f"{found.expansions:,}",
    )


def allowed(found: Certificate) -> str:
    """Return the limit of expansions of the search."""
    most = found.limits.expansions
    return "any" if most is None else f"{most:,}"


def default_table() -> str:
    """Format a row for each shipped task and number of players."""
    heads = ("task", "paper", "players", "steps", "bound", "proven", "expansions", "allowed")
    rows = [
        (
            f"`{folder}/{found.task}`",
            of_paper(folder, int(found.task[:2])),
            *claim(found),
            allowed(found),
        )
        for folder in (*FOLDERS, "training")
        for found in certificates(PROBLEMS / folder)
    ]
    return table(heads, rows)


def grouped() -> dict[tuple[str, str, int], list[Certificate]]:
    """Group the certificates of the generated instances by folder, task and players."""
    groups: dict[tuple[str, str, int], list[Certificate]] = defaultdict(list)
    for folder in FOLDERS:
        for found in certificates(PROBLEMS / "generated" / folder):
            task = re.sub(r"_s\d+$", "", found.task)
            groups[folder, task, found.seats].append(found)
    return dict(sorted(groups.items(), key=lambda row: (FOLDERS.index(row[0][0]), row[0])))


def counts(found: list[Certificate]) -> tuple[int, int, object]:
    """Return the number of instances, the number of proven ones, and the largest gap."""
    gaps = [c.gap for c in found if c.gap is not None]
    return len(found), sum(c.optimal for c in found), max(gaps, default="–")


def generated_totals() -> str:
    """Format a row for each folder and number of players."""
    totals: dict[tuple[str, int], list[Certificate]] = defaultdict(list)
    for (folder, _, seats), found in grouped().items():
        totals[folder, seats] += found
    heads = ("folder", "players", "instances", "proven", "largest gap")
    return table(heads, ((f"`{f}`", seats, *counts(c)) for (f, seats), c in totals.items()))


def generated_table() -> str:
    """Format a row for each task and number of players."""
    heads = ("task", "players", "proven", "least", "median", "most", "largest gap")
    rows = []
    for (folder, task, seats), found in grouped().items():
        lengths = [c.length for c in found if c.optimal and c.length is not None]
        spread: tuple[object, ...] = ("–", "–", "–")
        if lengths:
            spread = min(lengths), f"{statistics.median(lengths):g}", max(lengths)
        instances, proven, gap = counts(found)
        rows.append((f"`{folder}/{task}`", seats, f"{proven} of {instances}", *spread, gap))
    return table(heads, rows)


def published(folder: Path) -> Iterator[str]:
    """Yield the table of the published layouts, and every plan shorter than the paper's."""
    rows, plans = [], []
    for kind in FOLDERS:
        for path in sorted((folder / kind).glob("*.json")):
            task = load_task(str(path))
            found = certify(task, solve, BUDGET.limits())
            theirs = of_paper(kind, int(path.stem.split("_")[0]) + 1)
            name = f"{kind}/{path.stem}"
            rows.append((f"`{name}`", theirs, *claim(found)))
            shorter = found.length is not None and theirs != "–" and found.length < int(theirs)
            if shorter and found.plan:
                title = f'```text title="{path.stem}.plan"'
                plans += ["", f"`{name}`, {found.length} steps:", "", title, *found.plan, "```"]
    heads = ("published file", "paper", "players", "steps", "bound", "proven", "expansions")
    yield table(heads, rows)
    yield from plans


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the section on the published layouts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    folder = parser.parse_args(arguments).folder
    if not folder.is_dir():
        parser.error(f"not a folder: {folder}")
    print("\n".join(published(folder)))


if __name__ == "__main__":
    main()
