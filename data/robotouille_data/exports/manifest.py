"""`export.json`: what an export is of, what is in it, and what its files are."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.domain.files import whole_file
from robotouille.release import VERSION
from robotouille_data.database import in_pieces
from robotouille_data.errors import CatalogueError
from robotouille_data.exports.part import Entry
from robotouille_data.exports.request import Request
from robotouille_data.schema import EPISODES, LABELS

__all__ = [
    "CODEBOOK",
    "MANIFEST",
    "codebook_text",
    "file_sums",
    "read_json",
    "request_row",
    "summary",
    "write_manifest",
]

MANIFEST, CODEBOOK = "export.json", "codebook.json"


def request_row(request: Request) -> dict[str, Any]:
    """What was asked for; a query may name people, and is left out where names are."""
    query = request.query if request.names or not request.query else "left out with the names"
    return {
        "software": VERSION,
        "formats": [each.value for each in request.formats],
        "query": query,
        "labels_asked": dict(request.labels),
        "consent": dict([request.consent]) if request.consent else {},
        "names": request.names,
        "texts": request.texts,
        "system": request.system,
        "per_decision": request.per_decision,
        "about": asdict(request.about),
    }


def summary(connection: Connection, ids: Sequence[int]) -> dict[str, Any]:
    """How many episodes, seats and steps there are, of which tasks, versions and labels."""
    tasks: Counter[str] = Counter()
    versions: Counter[str] = Counter()
    labels: dict[str, Counter[str]] = {}
    seats = steps = 0
    its = EPISODES.c
    for piece in in_pieces(ids):
        query = sa.select(its.task, its.software, its.seats, its.steps).where(its.id.in_(piece))
        for task, software, players, taken in connection.execute(query):
            tasks[task] += 1
            versions[software] += 1
            seats += players
            steps += taken
        labelled = sa.select(LABELS.c.name, LABELS.c.value).where(LABELS.c.episode_id.in_(piece))
        for name, value in connection.execute(labelled):
            labels.setdefault(name, Counter())[value] += 1
    return {
        "episodes": len(ids),
        "seats": seats,
        "steps": steps,
        "tasks": dict(sorted(tasks.items())),
        "recorded_by": dict(sorted(versions.items())),
        "labels": {name: len(values) for name, values in sorted(labels.items())},
    }


def codebook_text(codebook: Mapping[str, Entry], data: Sequence[Mapping[str, Any]]) -> str:
    """The codebook as JSON: of each table or array its rows and what its columns mean.

    Args:
        data: What was written, as in `export.json`.
    """
    rows: Counter[str] = Counter()
    for each in data:
        rows[each["entry"]] += each["rows"]
    entries = [
        {
            "name": entry.name,
            "meaning": entry.meaning,
            "rows": rows[entry.name],
            "fields": [asdict(field) for field in entry.fields],
            **entry.notes,
        }
        for entry in codebook.values()
    ]
    return json.dumps({"entries": entries}, ensure_ascii=False, indent=1) + "\n"


def file_sums(folder: Path) -> dict[str, dict[str, Any]]:
    """The size and the SHA-256 of each file of an export."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            name = path.relative_to(folder).as_posix()
            found[name] = {"bytes": path.stat().st_size, "sha256": digest}
    return found


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write `export.json`. OSError if it cannot be written; then it is as it was."""
    text = json.dumps(manifest, ensure_ascii=False, indent=1)
    with whole_file(folder / MANIFEST) as file:
        file.write(f"{text}\n")


def read_json(folder: Path, name: str) -> dict[str, Any]:
    """`export.json` or the codebook of an export.

    Raises:
        CatalogueError: It is not there, or no such file.
    """
    try:
        found = json.loads((folder / name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise CatalogueError(f"{folder}: no export: {name} cannot be read") from None
    if not isinstance(found, dict):
        raise CatalogueError(f"{folder}: no export: {name} is another file")
    return found
