"""The card of an export: a README.md in the form that Hugging Face's `datasets` reads, and LICENSE.

It is made of `export.json` and the codebook alone, so that it can be made anew."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from robotouille.domain.files import whole_file
from robotouille.program import printable
from robotouille_data.errors import CatalogueError
from robotouille_data.exports.manifest import CODEBOOK, MANIFEST, read_json, write_manifest
from robotouille_data.exports.request import TABLES, About, ExportFormat

__all__ = ["card_text", "check_license", "rewrite_card", "write_card"]

PLAIN = re.compile(r"[A-Za-z0-9.+-]{1,64}")
"""What is a version's name, and needs no quotation: recordings say what they want."""
LICENSES = (
    "CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC-BY-NC-SA-4.0", "CC-BY-ND-4.0",
    "CC-BY-NC-ND-4.0", "CDLA-Permissive-2.0", "CDLA-Sharing-1.0", "ODbL-1.0", "ODC-By-1.0",
    "PDDL-1.0", "MIT", "Apache-2.0", "BSD-3-Clause",
)  # fmt: skip
"""Identifiers of SPDX for what data is usually given under."""
OWN_LICENSE = re.compile(r"LicenseRef-[A-Za-z0-9.-]{1,48}")
"""What SPDX has for all others."""
DTYPES = {
    "biginteger": "int64",
    "integer": "int32",
    "double": "float64",
    "boolean": "bool",
    "text": "string",
}
LOADED = (*TABLES, ExportFormat.CHAT)
"""The formats that `datasets` loads, one of them from a folder: the first that is there."""
LOADING = {
    "parquet": 'polars.read_parquet("{path}")',
    "csv": 'polars.read_csv("{path}")',
    "jsonl": 'polars.read_ndjson("{path}")',
    "chat": 'datasets.load_dataset("json", data_files="{path}")',
    "arrays": 'numpy.load("{path}", allow_pickle=False)',
    "minari": 'minari.load_dataset("{name}")  # with MINARI_DATASETS_PATH={folder}',
}
NO_LICENSE = (
    "No licence was given: nobody but its makers may use these data. "
    "`robotouille data card FOLDER --license CC-BY-4.0` gives one."
)
LEFT_OUT = {
    "unknown": "ids of the query that are no episodes of the catalogue",
    "label": "episodes without the labels",
    "consent": "episodes without the label of consent",
}


def check_license(identifier: str) -> None:
    """Nothing is done; CatalogueError if that is no licence of `LICENSES`, nor one's own as
    `LicenseRef-…`."""
    if not identifier or identifier in LICENSES or OWN_LICENSE.fullmatch(identifier):
        return
    shown = identifier[:60]
    near = get_close_matches(shown.lower(), {each.lower(): each for each in LICENSES}, 1)
    named = next((each for each in LICENSES if near and each.lower() == near[0]), "")
    hint = f"; did you mean {named}?" if named else "."
    raise CatalogueError(
        f"{shown!r} is no licence's identifier of SPDX that is known here{hint} There are "
        f"{', '.join(LICENSES)}; another is written LicenseRef-NAME"
    )


def write_card(folder: Path, manifest: Mapping[str, Any], codebook: Mapping[str, Any]) -> str:
    """Write README.md, and LICENSE if a licence was given; the card."""
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
    """Give an export another title, description, license or contact; its card.

    Args:
        about: Fields of `About`; those that are not there stay as they are.

    Raises:
        CatalogueError: It is no export, or the licence has no identifier.
        OSError: It cannot be written.
    """
    manifest, codebook = read_json(folder, MANIFEST), read_json(folder, CODEBOOK)
    try:
        told = replace(About(**manifest["about"]), **about)
        check_license(told.license)
        manifest["about"] = asdict(told)
        card = write_card(folder, manifest, codebook) if about else card_text(manifest, codebook)
    except (KeyError, TypeError, AttributeError) as error:
        raise CatalogueError(f"{folder}: {MANIFEST} is of another version: {error!r}") from None
    if about:
        write_manifest(folder, manifest)
    return card


def card_text(manifest: Mapping[str, Any], codebook: Mapping[str, Any]) -> str:
    """The card of an export."""
    about = About(**manifest["about"])
    blocks = [
        "\n".join(["---", *_front_matter(manifest, codebook, about), "---"]),
        f"# {_title(about)}",
        about.description
        or "Episodes of Robotouille, a kitchen that people, bots and models share.",
        f"## What is in it\n\n{_contents(manifest, codebook)}",
        f"## How it was made\n\n{_origin(manifest)}",
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
    return f"SPDX-License-Identifier: {about.license}\n\n{_title(about)}\n{by}Its text: {page}\n"


# The front matter: JSON's strings are YAML's, whatever is in them


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
        # Of a file without rows `datasets` says that it is damaged.
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
    tasks = ", ".join(f"{_quoted(name)} ({count:,})" for name, count in manifest["tasks"].items())
    labels = ", ".join(f"{_quoted(name)} ({n:,} values)" for name, n in manifest["labels"].items())
    lines = [
        f"{counts}{manifest['steps']:,} steps.",
        f"Tasks: {tasks}.",
        f"Labels: {labels or 'none'}.",
        *_parts(manifest),
        _table(["", "rows", "what it is"], _entries(codebook)),
        f"`codebook.json` says what each column is, and in which unit; `{MANIFEST}` has the sums "
        "of all columns, and the size and SHA-256 of each file.",
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
    versions = ", ".join(
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
        f"Filters: {', '.join(filters) or 'none: all episodes of the catalogue'}.",
    ]
    if left_out := {k: n for k, n in manifest["left_out"].items() if n}:
        told = "; ".join(f"{count:,} {LEFT_OUT[name]}" for name, count in left_out.items())
        lines.append(f"Left out: {told}.")
    if manifest["faults"]:
        lines.append(f"{len(manifest['faults']):,} episodes lack their recording's part: see "
                     f"`faults` in `{MANIFEST}`.")  # fmt: skip
    return "\n".join(lines)


def _people(manifest: Mapping[str, Any]) -> str:
    names = (
        "Names and pseudonyms are as the participants and the server gave them."
        if manifest["names"]
        else "Names and pseudonyms are replaced by `p1`, `p2`, …, the same in all files of this "
        "export; the codes and owners of episodes and the sessions of participants are left out."
    )
    texts = (
        "What people and models have written is in it, and may name somebody."
        if manifest["texts"]
        else "What people and models have written (chat, reasoning, notes, requests that were no "
        "action) is left out."
    )
    rest = (
        "Labels are as they were given. The id of an episode is the hash of its recording, by "
        "which who has the recording finds it."
    )
    return f"{names} {texts} {rest}"


def _quoted(text: str) -> str:
    """What somebody has worded, such that it breaks no line, table or quotation."""
    words = " ".join(text.split()).replace("`", "'").replace("|", "/")
    return f"`{printable(words)}`"


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
