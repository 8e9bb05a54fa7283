"""Write an export: a folder with data, a codebook, a card and `export.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

from sqlalchemy.engine import URL, Connection

from robotouille.errors import MissingExtraError
from robotouille_data.answers.query import reading
from robotouille_data.answers.selection import Selection, select_episodes
from robotouille_data.errors import CatalogueError
from robotouille_data.exports.card import check_license, write_card
from robotouille_data.exports.manifest import (
    CODEBOOK,
    codebook_text,
    file_sums,
    request_row,
    summary,
    write_manifest,
)
from robotouille_data.exports.part import Entry, Part, Written
from robotouille_data.exports.privacy import Privacy
from robotouille_data.exports.request import TABLES, ExportFormat, Request
from robotouille_data.exports.splitting import groups, split
from robotouille_data.exports.task_slugs import task_slugs
from robotouille_data.exports.whole_folder import whole_folder
from robotouille_data.versions import catalogue_version

__all__ = ["Exported", "Progress", "export"]

Progress = Callable[[int, int], None]
"""Is told how many episodes are done, and how many there are."""

WRITERS = {
    **dict.fromkeys(TABLES, ("robotouille_data.exports.formats.tables", "write_tables")),
    ExportFormat.CHAT: ("robotouille_data.exports.formats.chat", "write_chat"),
    ExportFormat.ARRAYS: ("robotouille_data.exports.formats.arrays", "write_arrays"),
    ExportFormat.MINARI: ("robotouille_data.exports.formats.minari_sets", "write_minari"),
}
"""What writes each format, imported where it is used: each needs other libraries."""

EXTRAS = {ExportFormat.ARRAYS: "rl", ExportFormat.MINARI: "minari"}


@dataclass(frozen=True, slots=True)
class Exported:
    """What became of an export: how many episodes each part has (one without a name, if it is not
    split), how many were left out for what reason, and why of some, by id, nothing was written."""

    episodes: Mapping[str, int]
    left_out: Mapping[str, int]
    faults: Mapping[int, str]


def export(
    url: URL,
    folder: Path,
    request: Request,
    progress: Progress = lambda done, total: None,
) -> Exported:
    """Write an export of a catalogue; the folder is whole, or not there.

    Args:
        url: Of the catalogue's database.
        folder: A new one, or an empty one.
        progress: Is called when some more are done.

    Raises:
        CatalogueError: There is no catalogue of this version, nothing is left of it, or there is
            something in the folder, or it cannot be written.
        UnavailableError: The database cannot be read now.
        MissingExtraError: A library of the format is not installed.
    """
    check_license(request.about.license)
    if len([each for each in request.formats if each in TABLES]) > 1:
        raise CatalogueError("tables are exported in one format at a time")
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
    request: Request,
    selection: Selection,
    progress: Progress,
) -> Exported:
    parts, told = _split(connection, request, selection.ids)
    faults, codebook = dict[int, str](), dict[str, Entry]()
    whole = _whole(connection, folder, request, selection.ids, progress, faults, codebook)
    rows = [
        row
        for (name, its), format_ in product(parts.items(), request.formats)
        for row in _write_part(replace(whole, name=name, ids=its, format=format_))
    ]
    if not any(row["rows"] for row in rows):
        reasons = "; ".join(sorted(set(faults.values())))
        raise CatalogueError(f"there is nothing to write{f': {reasons}' if reasons else ''}")
    manifest = {
        **request_row(request),
        "catalogue": catalogue_version(connection),
        **summary(connection, selection.ids),
        "split": told,
        "left_out": selection.left_out,
        "faults": {str(number): fault for number, fault in faults.items()},
        "data": rows,
    }
    _write_words(folder, manifest, codebook_text(codebook, rows))
    counts = {name: len(its) for name, its in parts.items()}
    return Exported(counts, selection.left_out, faults)


def _whole(
    connection: Connection,
    folder: Path,
    request: Request,
    ids: Sequence[int],
    progress: Progress,
    faults: dict[int, str],
    codebook: dict[str, Entry],
) -> Part:
    """All episodes as one part, of which the others are made."""
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
    """Write the files of a part; what `export.json` says of each."""
    part.folder.mkdir(exist_ok=True)
    for written in _writer(part.format)(part):
        yield {"part": part.name, "format": part.format.value, **asdict(written)}


def _split(
    connection: Connection, request: Request, ids: Sequence[int]
) -> tuple[dict[str, Sequence[int]], dict[str, Any]]:
    """The parts, and what `export.json` says of them."""
    if not request.split:
        return {"": ids}, {}
    together = groups(connection, ids, request.split_by)
    parts = split(together, request.split)
    if empty := [name for name, its in parts.items() if not its]:
        message = (
            f"nothing is left for {', '.join(empty)}: the episodes are {len(together)} groups that "
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


def _writer(format_: ExportFormat) -> Callable[[Part], Iterator[Written]]:
    module, name = WRITERS[format_]
    try:
        found: Callable[[Part], Iterator[Written]] = getattr(import_module(module), name)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("robotouille"):
            raise
        raise MissingExtraError(f"the format {format_}", EXTRAS.get(format_, "data")) from None
    return found


def _write_words(folder: Path, manifest: dict[str, Any], codebook: str) -> None:
    """The codebook, the card and `export.json`, which has the sums of all files but those that
    `data card` writes anew."""
    (folder / CODEBOOK).write_text(codebook, encoding="utf-8")
    manifest["files"] = file_sums(folder)
    write_manifest(folder, manifest)
    write_card(folder, manifest, json.loads(codebook))
