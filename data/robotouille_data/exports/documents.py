"""Documents of an export: `export.json`, the codebook, the card and LICENSE.

The card is a README.md in the format that Hugging Face's `datasets` reads. It is made only from
`export.json` and the codebook, so `data card` can make it again.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.domain.json_files import parse_json
from robotouille.errors import FileError
from robotouille.files.reading import read_text
from robotouille.files.writing import whole_file
from robotouille.installation import VERSION
from robotouille.terminal import printable, printable_json
from robotouille_data.database import CatalogueError, in_pieces
from robotouille_data.exports.request import TABLES, About, ExportEntry, ExportFormat, ExportRequest
from robotouille_data.schema import EPISODES, LABELS

MANIFEST, CODEBOOK = "export.json", "codebook.json"
MAX_BYTES = 64 << 20
"""Bytes of one of these files."""


def request_row(request: ExportRequest) -> dict[str, Any]:
    """Return the request for `export.json`.

    A query may contain names, so it is left out together with them.
    """
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
    """Return counts of episodes, seats, steps, tasks, versions and labels."""
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


def codebook_text(codebook: Mapping[str, ExportEntry], data: Sequence[Mapping[str, Any]]) -> str:
    """Return the codebook as JSON, with the rows and the columns of each table or array.

    Args:
        data: The written files, as in `export.json`.
    """
    rows: Counter[str] = Counter()
    counted: dict[str, str] = {}
    for each in data:
        # Several formats may contain one table. Its rows count once.
        if counted.setdefault(each["entry"], each["format"]) == each["format"]:
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
    """Return the size and SHA-256 of each file of an export."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            name = path.relative_to(folder).as_posix()
            found[name] = {"bytes": path.stat().st_size, "sha256": digest}
    return found


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write `export.json`. If that fails, the old file remains."""
    text = json.dumps(manifest, ensure_ascii=False, indent=1)
    with whole_file(folder / MANIFEST) as file:
        file.write(f"{text}\n")


def read_json(folder: Path, name: str) -> dict[str, Any]:
    """Read `export.json` or the codebook of an export.

    Raises:
        CatalogueError: The file is missing or invalid.
    """
    try:
        found = parse_json(read_text(folder / name, most=MAX_BYTES), name)
    except (OSError, ValueError, FileError):
        raise CatalogueError(f"{folder}: not an export; {name} cannot be read") from None
    if not isinstance(found, dict):
        raise CatalogueError(f"{folder}: not an export; {name} is not an object")
    return found


# Names of tasks, labels and versions come from recordings, so the card quotes them as code, in
# which markup has no effect.
PLAIN = re.compile(r"[A-Za-z0-9.+-]{1,64}")
"""Versions that are shown without quotes. A recording can contain any text as its version."""
LICENSES = (
    "CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC-BY-NC-SA-4.0", "CC-BY-ND-4.0",
    "CC-BY-NC-ND-4.0", "CDLA-Permissive-2.0", "CDLA-Sharing-1.0", "ODbL-1.0", "ODC-By-1.0",
    "PDDL-1.0", "MIT", "Apache-2.0", "BSD-3-Clause",
)  # fmt: skip
"""SPDX identifiers of common licences for data."""
OWN_LICENSE = re.compile(r"LicenseRef-[A-Za-z0-9.-]{1,48}")
"""Identifiers for licences that SPDX does not list."""
MAX_LISTED = 50
"""Tasks, labels and versions that the card lists. `export.json` has all."""
MAX_SHOWN = 500
"""Characters of a text from outside that the card shows."""
DTYPES = {
    "biginteger": "int64",
    "integer": "int32",
    "double": "float64",
    "boolean": "bool",
    "text": "string",
}
LOADED = (*TABLES, ExportFormat.CHAT)
"""Formats that `datasets` loads. The card lists files of the first one that the export has."""
LOADING = {
    "parquet": 'polars.read_parquet("{path}")',
    "csv": 'polars.read_csv("{path}")',
    "jsonl": 'polars.read_ndjson("{path}")',
    "chat": 'datasets.load_dataset("json", data_files="{path}")',
    "arrays": 'numpy.load("{path}", allow_pickle=False)',
    "minari": 'minari.load_dataset("{name}")  # with MINARI_DATASETS_PATH={folder}',
}
NO_LICENSE = (
    "No licence was given, so only the authors may use the data. "
    "`robotouille data card FOLDER --license CC-BY-4.0` sets one."
)
LEFT_OUT = {
    "unknown": "ids of the query that are not in the catalogue",
    "label": "episodes without the labels",
    "consent": "episodes without the label of consent",
}


def check_license(identifier: str) -> None:
    """Check the identifier of a licence.

    Raises:
        CatalogueError: The identifier is neither one of `LICENSES` nor a `LicenseRef-…`.
    """
    if not identifier or identifier in LICENSES or OWN_LICENSE.fullmatch(identifier):
        return
    shown = identifier[:60]
    near = get_close_matches(shown.lower(), {each.lower(): each for each in LICENSES}, 1)
    named = next((each for each in LICENSES if near and each.lower() == near[0]), "")
    hint = f"; did you mean {named}?" if named else "."
    raise CatalogueError(
        f"unknown SPDX identifier {shown!r}{hint} Known identifiers: {', '.join(LICENSES)}; write "
        "another licence as LicenseRef-NAME"
    )


def write_card(folder: Path, manifest: Mapping[str, Any], codebook: Mapping[str, Any]) -> str:
    """Write README.md, and LICENSE if a licence was given. Return the text of the card."""
    card = card_text(manifest, codebook)
    with whole_file(folder / "README.md") as file:
        file.write(card)
    about, path = About(**manifest["about"]), folder / "LICENSE"
    if about.license:
        with whole_file(path) as file:
            file.write(_license_text(about))
    else:
        path.unlink(missing_ok=True)
    return card


def rewrite_card(folder: Path, about: Mapping[str, str]) -> str:
    """Change the title, description, licence or contact of an export, and return its card.

    Args:
        about: Fields of `About` to change.

    Raises:
        CatalogueError: The folder is not an export, or the licence is unknown.
        OSError: The card cannot be written.
    """
    manifest, codebook = read_json(folder, MANIFEST), read_json(folder, CODEBOOK)
    try:
        changed = replace(About(**manifest["about"]), **about)
        check_license(changed.license)
        manifest["about"] = asdict(changed)
        card = write_card(folder, manifest, codebook) if about else card_text(manifest, codebook)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise CatalogueError(f"{folder}: {MANIFEST} has another version: {error!r}") from None
    if about:
        write_manifest(folder, manifest)
    return card


def card_text(manifest: Mapping[str, Any], codebook: Mapping[str, Any]) -> str:
    """Return the card of an export."""
    about = About(**manifest["about"])
    blocks = [
        "\n".join(["---", *_front_matter(manifest, codebook, about), "---"]),
        f"# {_title(about)}",
        about.description or "Episodes of Robotouille, a kitchen for people, bots and models.",
        f"## Contents\n\n{_contents(manifest, codebook)}",
        f"## Origin\n\n{_origin(manifest)}",
        f"## People\n\n{_people(manifest)}",
        f"## Licence\n\n{about.license or NO_LICENSE}",
    ]
    if about.contact:
        blocks.append(f"## Contact\n\n{about.contact}")
    return "\n\n".join(blocks) + "\n"


def _title(about: About) -> str:
    return about.title or "Robotouille episodes"


def _license_text(about: About) -> str:
    by = f"Licensor: {about.contact}\n" if about.contact else ""
    page = f"https://spdx.org/licenses/{about.license}.html"
    return f"SPDX-License-Identifier: {about.license}\n\n{_title(about)}\n{by}Text: {page}\n"


# The front matter. Every JSON string is also a YAML string, so no text can break it.


def _front_matter(
    manifest: Mapping[str, Any], codebook: Mapping[str, Any], about: About
) -> Iterator[str]:
    yield f"license: {json.dumps(about.license.lower() or 'other')}"
    yield f"pretty_name: {json.dumps(_title(about))}"
    yield "language:\n- en"
    yield "tags:"
    yield from (f"- {tag}" for tag in ("robotouille", "multi-agent", "planning", "human-ai"))
    files: dict[str, list[Mapping[str, Any]]] = {}
    loaded = next((each for each in LOADED if each in manifest["formats"]), None)
    for written in manifest["data"]:
        # `datasets` rejects a file without rows as damaged.
        if written["rows"] and written["format"] == loaded:
            files.setdefault(written["entry"], []).append(written)
    if not files:
        return
    yield "configs:"
    for number, (name, its) in enumerate(files.items()):
        yield f"- config_name: {name}"
        if number == 0:
            yield "  default: true"
        yield "  data_files:"
        for written in its:
            yield f"  - split: {written['part'] or 'train'}"
            yield f"    path: {json.dumps(written['path'])}"
    if loaded in TABLES:
        yield "dataset_info:"
        for entry in codebook["entries"]:
            if entry["name"] in files:
                yield from _features(entry)


def _features(entry: Mapping[str, Any]) -> Iterator[str]:
    yield f"- config_name: {entry['name']}"
    yield "  features:"
    for field in entry["fields"]:
        yield f"  - name: {field['name']}"
        yield f"    dtype: {DTYPES[field['type']]}"


# The text


def _contents(manifest: Mapping[str, Any], codebook: Mapping[str, Any]) -> str:
    counts = f"{manifest['episodes']:,} episodes, {manifest['seats']:,} seats, "
    tasks = _listed(f"{_quoted(name)} ({count:,})" for name, count in manifest["tasks"].items())
    labels = _listed(f"{_quoted(name)} ({n:,} values)" for name, n in manifest["labels"].items())
    lines = [
        f"{counts}{manifest['steps']:,} steps.",
        f"Tasks: {tasks}.",
        f"Labels: {labels or 'none'}.",
        *_parts(manifest),
        _table(["", "rows", "meaning"], _entries(codebook)),
        f"`codebook.json` has the meaning and unit of each column. `{MANIFEST}` has the sums of "
        "the columns, and the size and SHA-256 of each file.",
    ]
    examples = {written["format"]: written for written in reversed(manifest["data"])}
    code = [
        LOADING[name].format(
            path=first["path"], name=first["entry"], folder=Path("FOLDER") / first["part"]
        )
        for name, first in sorted(examples.items())
    ]
    lines.append("\n".join(["```python", *code, "```"]))
    return "\n\n".join(lines)


def _entries(codebook: Mapping[str, Any]) -> list[Sequence[str]]:
    return [
        (_quoted(e["name"]), f"{e['rows']:,}", printable(e["meaning"])) for e in codebook["entries"]
    ]


def _parts(manifest: Mapping[str, Any]) -> Iterator[str]:
    if split := manifest["split"]:
        parts = ", ".join(f"`{name}` {count:,}" for name, count in split["episodes"].items())
        yield (
            f"Parts, in episodes: {parts}. Episodes that share a human participant or the label "
            f"{_quoted(split['by'])} are in the same part."
        )


def _origin(manifest: Mapping[str, Any]) -> str:
    versions = _listed(
        f"{name if PLAIN.fullmatch(name) else _quoted(name)} ({count:,})"
        for name, count in manifest["recorded_by"].items()
    )
    filters = [
        f"label {_quoted(f'{name}={value}')}" for name, value in manifest["labels_asked"].items()
    ]
    filters += [
        f"consent {_quoted(f'{name}={value}')}" for name, value in manifest["consent"].items()
    ]
    if manifest["query"]:
        filters.append(f"the query {_quoted(manifest['query'])}")
    lines = [
        f"Recorded by Robotouille {versions}, exported by {manifest['software']} from a catalogue "
        f"of version {manifest['catalogue']}.",
        f"Filters: {', '.join(filters) or 'none, all episodes of the catalogue'}.",
    ]
    if left_out := {k: n for k, n in manifest["left_out"].items() if n}:
        counts = "; ".join(f"{count:,} {LEFT_OUT[name]}" for name, count in left_out.items())
        lines.append(f"Left out: {counts}.")
    if manifest["faults"]:
        lines.append(f"{len(manifest['faults']):,} episodes are missing from some files; see "
                     f"`faults` in `{MANIFEST}`.")  # fmt: skip
    return "\n".join(lines)


def _people(manifest: Mapping[str, Any]) -> str:
    names = (
        "The data contains the names that participants chose and the server's pseudonyms."
        if manifest["names"]
        else "Names and pseudonyms are replaced with `p1`, `p2`, …, consistently in all files. "
        "The codes and owners of episodes, the details of their ends and the sessions of "
        "participants are left out."
    )
    texts = (
        "The data contains text that people and models wrote, which may identify people."
        if manifest["texts"]
        else "Text that people and models wrote (chat, reasoning, notes, malformed requests) is "
        "left out."
    )
    rest = (
        "Labels are unchanged. The id of an episode is the hash of its recording, so anyone who "
        "has the recording can identify the episode."
    )
    return f"{names} {texts} {rest}"


def _quoted(text: str) -> str:
    """Return outside text as inline code that cannot break a line, table or quotation."""
    words = " ".join(text[: MAX_SHOWN + 1].split()).replace("`", "'").replace("|", "/")
    shown = words if len(text) <= MAX_SHOWN else f"{words[:MAX_SHOWN]}…"
    return f"`{printable_json(shown)}`"


def _listed(items: Iterable[str]) -> str:
    """Return the first items, and how many more there are."""
    every = list(items)
    more = len(every) - MAX_LISTED
    return ", ".join(every[:MAX_LISTED]) + (f" and {more:,} more" if more > 0 else "")


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
