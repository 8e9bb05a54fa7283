"""Write an export: a folder with data, a codebook, a card and `export.json`."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection

from robotouille.errors import MissingExtraError
from robotouille.files.drafts import drafted_folder
from robotouille_data.database import CatalogueError, catalogue_version, in_pieces
from robotouille_data.exports.documents import (
    CODEBOOK,
    check_license,
    codebook_text,
    file_sums,
    request_row,
    summary,
    write_card,
    write_manifest,
)
from robotouille_data.exports.people import groups, split
from robotouille_data.exports.privacy import Privacy
from robotouille_data.exports.request import (
    TABLES,
    ExportEntry,
    ExportFormat,
    ExportRequest,
    Part,
    WrittenFile,
)
from robotouille_data.query import Selection, reading, select_episodes
from robotouille_data.schema import EPISODES

UNUSUAL = re.compile(r"[^A-Za-z0-9_]+")
MAX_SLUG = 80


def task_slugs(connection: Connection, ids: Sequence[int]) -> dict[str, str]:
    """Return names for files and data sets by the digests of the episodes' tasks.

    A name is the task's name, followed by a part of the digest if several tasks have that name. If
    these names are not distinct either, the whole digest follows each.
    """
    names: dict[str, str] = {}
    for piece in in_pieces(ids):
        query = sa.select(EPISODES.c.digest, EPISODES.c.task).where(EPISODES.c.id.in_(piece))
        for digest, task in connection.execute(query.distinct()):
            names[digest] = UNUSUAL.sub("-", task).strip("-")[:MAX_SLUG] or "task"
    often = Counter(name.lower() for name in names.values())
    # Names are compared without case because some file systems ignore it.
    short = {
        digest: f"{name}-{digest[:8]}" if often[name.lower()] > 1 else name
        for digest, name in names.items()
    }
    if len({name.lower() for name in short.values()}) == len(short):
        return short
    # A task can have the name that another one gets with its digest.
    return {digest: f"{name}-{digest}" for digest, name in names.items()}


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """Create a temporary folder that becomes `folder` on success and is deleted on failure.

    Raises:
        CatalogueError: The folder exists and is not empty, or cannot be written.
    """
    if folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir()))):
        raise CatalogueError(f"{folder} already exists; choose a new folder or delete it first")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with drafted_folder(folder) as draft:
            yield draft
            draft.rename(folder)
    except OSError as error:
        raise CatalogueError(f"{folder} cannot be written: {error.strerror or error}") from None


Progress = Callable[[int, int], None]
"""Called with the number of finished episodes and their total."""

WRITERS = {
    **dict.fromkeys(TABLES, ("robotouille_data.exports.tables", "write_tables")),
    ExportFormat.CHAT: ("robotouille_data.exports.recorded", "write_chat"),
    ExportFormat.ARRAYS: ("robotouille_data.exports.arrays", "write_arrays"),
    ExportFormat.MINARI: ("robotouille_data.exports.minari_sets", "write_minari"),
}
"""Writer of each format. They are imported on demand because each needs other libraries."""

EXTRAS = {ExportFormat.ARRAYS: "rl", ExportFormat.MINARI: "minari"}


@dataclass(frozen=True, slots=True)
class ExportResult:
    """Result of an export.

    Attributes:
        episodes: Number of episodes by part. Without a split, the part has an empty name.
        left_out: Number of episodes left out by reason.
        faults: Reasons why episodes could not be written, by episode id.
    """

    episodes: Mapping[str, int]
    left_out: Mapping[str, int]
    faults: Mapping[int, str]


def export(
    url: URL,
    folder: Path,
    request: ExportRequest,
    progress: Progress = lambda done, total: None,
) -> ExportResult:
    """Write an export of a catalogue. The folder is either complete or not created.

    Args:
        url: URL of the database.
        folder: A new or empty folder.
        progress: Called after each group of episodes.

    Raises:
        CatalogueError: There is no catalogue of this version, no episode is left, or the folder
            is not empty or cannot be written.
        UnavailableError: The database cannot be read now.
        MissingExtraError: A library for the format is not installed.
    """
    check_license(request.about.license)
    with reading(url) as connection, whole_folder(folder) as draft:
        selection = select_episodes(
            connection,
            url,
            request.query or None,
            request.labels,
            request.consent,
            request.seconds,
        )
        return _write(connection, draft, request, selection, progress)


def _write(
    connection: Connection,
    folder: Path,
    request: ExportRequest,
    selection: Selection,
    progress: Progress,
) -> ExportResult:
    parts, description = _split(connection, request, selection.ids)
    faults, codebook = dict[int, str](), dict[str, ExportEntry]()
    whole = _whole(connection, folder, request, selection.ids, progress, faults, codebook)
    rows = [
        row
        for (name, its), format_ in product(parts.items(), request.formats)
        for row in _write_part(replace(whole, name=name, ids=its, format=format_))
    ]
    # Raised within `whole_folder`, which then deletes the draft: an export is complete or absent
    # (docs/decisions/0035).
    if not any(row["rows"] for row in rows):
        reasons = "; ".join(sorted(set(faults.values())))
        raise CatalogueError(f"nothing to write{f': {reasons}' if reasons else ''}")
    manifest = {
        **request_row(request),
        "catalogue": catalogue_version(connection),
        **summary(connection, selection.ids),
        "split": description,
        "left_out": selection.left_out,
        "faults": {str(number): fault for number, fault in faults.items()},
        "data": rows,
    }
    _write_documents(folder, manifest, codebook_text(codebook, rows))
    counts = {name: len(its) for name, its in parts.items()}
    return ExportResult(counts, selection.left_out, faults)


def _whole(
    connection: Connection,
    folder: Path,
    request: ExportRequest,
    ids: Sequence[int],
    progress: Progress,
    faults: dict[int, str],
    codebook: dict[str, ExportEntry],
) -> Part:
    """Return a part with all episodes, from which the parts of a split are derived."""
    done = 0

    def more(count: int) -> None:
        nonlocal done
        done += count
        progress(done // len(request.formats), len(ids))

    more(0)
    return Part(
        connection=connection,
        request=request,
        format=request.formats[0],
        privacy=Privacy(connection, ids, names=request.names, texts=request.texts),
        root=folder,
        name="",
        ids=ids,
        tasks=task_slugs(connection, ids),
        done=more,
        faults=faults,
        codebook=codebook,
    )


def _write_part(part: Part) -> Iterator[dict[str, Any]]:
    """Write the files of a part, and yield their rows for `export.json`."""
    part.folder.mkdir(exist_ok=True)
    for written in _writer(part.format)(part):
        yield {"part": part.name, "format": part.format.value, **asdict(written)}


def _split(
    connection: Connection, request: ExportRequest, ids: Sequence[int]
) -> tuple[dict[str, Sequence[int]], dict[str, Any]]:
    """Return the parts and their description for `export.json`."""
    if not request.split:
        return {"": ids}, {}
    together = groups(connection, ids, request.split_by)
    parts = split(together, request.split)
    if empty := [name for name, its in parts.items() if not its]:
        message = (
            f"no episodes for {', '.join(empty)}: the episodes form {len(together)} groups that "
            f"share participants or the label {request.split_by!r}"
        )
        raise CatalogueError(message)
    told = {
        "by": request.split_by,
        "shares": dict(request.split),
        "groups": len(together),
        "episodes": {name: len(its) for name, its in parts.items()},
    }
    return dict(parts), told


def _writer(format_: ExportFormat) -> Callable[[Part], Iterator[WrittenFile]]:
    module, name = WRITERS[format_]
    try:
        found: Callable[[Part], Iterator[WrittenFile]] = getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("robotouille"):
            raise
        raise MissingExtraError(f"the format {format_}", EXTRAS.get(format_, "data")) from None
    return found


def _write_documents(folder: Path, manifest: dict[str, Any], codebook: str) -> None:
    """Write the codebook, the card and `export.json`.

    `export.json` has the hashes of all files except those that `data card` rewrites.
    """
    (folder / CODEBOOK).write_text(codebook, encoding="utf-8")
    manifest["files"] = file_sums(folder)
    write_manifest(folder, manifest)
    write_card(folder, manifest, json.loads(codebook))
