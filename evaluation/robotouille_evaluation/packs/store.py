"""Folders of packs: JSON files that can be read and compared, and a manifest of their hashes.

    manifest.json             format, name, version, digest, and the hash of every file
    domain.json tasks.json instances.json prompts.json examples.json experiments.json
    figures.json              published results, if the pack has any

Problems are stored as JSON values, not as strings.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from pydantic import TypeAdapter, ValidationError

from robotouille.domain.fast_failing import fast_failing
from robotouille.domain.json_files import parse_json, weight
from robotouille.errors import Fault, FileError, RobotouilleError, did_you_mean
from robotouille.files.drafts import drafted_folder
from robotouille.files.reading import is_file, read_bytes
from robotouille_evaluation.packs.experiment_settings import setting_faults
from robotouille_evaluation.packs.pack import Pack, canonical_json, fields_of

FORMAT = "robotouille-pack/1"
MANIFEST = "manifest.json"
LISTS = ("tasks", "instances", "prompts", "examples", "experiments")
OPTIONAL = "figures"
WITH_PROBLEMS = ("tasks", "instances")
FILES = ("domain.json", *(f"{name}.json" for name in (*LISTS, OPTIONAL)))
MAX_PACK_BYTES, MAX_PACK_VALUES = 96 * 1024 * 1024, 12_000_000
"""Bytes of a pack's files, and their `weight`. A pack of 10,000 problems of the paper's size has
84 MB and 10 million values."""

_packs = fast_failing(TypeAdapter(Pack).core_schema)


class PackSize:
    """Size of a pack so far, with the limits that apply when the pack is read."""

    def __init__(self, source: Path) -> None:
        self._source = source
        self._bytes = 0
        self._values = 0

    def add(self, text: str) -> None:
        """Count a part of the pack in JSON, or raise FileError if the pack is too large."""
        self._bytes += len(text) if text.isascii() else len(text.encode())
        self._values += weight(text)
        if self._bytes > MAX_PACK_BYTES:
            _fail(self._source, f"the pack is larger than {MAX_PACK_BYTES:,} bytes")
        if self._values > MAX_PACK_VALUES:
            _fail(
                self._source,
                f"the pack has up to {self._values:,} values; at most {MAX_PACK_VALUES:,} are read",
            )


def default_folder(name: str) -> Path:
    """Return the default folder of a pack: `packs/NAME` in the working folder."""
    return Path("packs") / name


def write_pack(pack: Pack, folder: Path) -> None:
    """Write a pack to a folder completely or not at all, replacing an earlier pack.

    Raises:
        FileError: The pack is too large to be read again or cannot be written, or the folder
            contains something else.
    """
    texts, size = _files(pack), PackSize(folder)
    for text in texts.values():
        size.add(text)
    _restore(folder)
    if folder.exists() and (found := _other_content(folder)):
        _fail(folder, f"already contains what is not a pack: {found}; choose another folder")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with drafted_folder(folder) as draft:
            for name, text in texts.items():
                (draft / name).write_bytes(text.encode())
            _put_in_place(draft, folder)
    except OSError as error:
        _fail(folder, f"cannot be written: {error.strerror or error}")


def _put_in_place(draft: Path, folder: Path) -> None:
    """Rename a draft to `folder`, and delete the earlier folder."""
    old = _former(folder)
    try:
        if folder.exists():
            shutil.rmtree(old, ignore_errors=True)
            folder.replace(old)
        draft.replace(folder)
    finally:
        with suppress(OSError):
            if old.exists() and not folder.exists():
                old.replace(folder)
        # After the new pack is in place, a failure to delete the old one does no harm.
        if folder.exists():
            shutil.rmtree(old, ignore_errors=True)


def _former(folder: Path) -> Path:
    """Return the name of an earlier pack until the new one is in place."""
    # Not the name of a draft: drafts are deleted after a kill, and this may be the only copy.
    return folder.with_name(f".{folder.name}.old")


def _restore(folder: Path) -> None:
    """Give a pack its name back if a kill stopped its replacement."""
    with suppress(OSError, ValueError):
        if not folder.exists():
            _former(folder).replace(folder)


def read_pack(folder: Path, *, digest: str | None = None) -> Pack:
    """Return the pack in a folder after checking its hashes.

    Args:
        digest: Expected digest, such as that of a run's pack.

    Raises:
        FileError: The folder is not a pack, has another format or digest, or is damaged.
    """
    _restore(folder)
    manifest = _read_manifest(folder)
    texts = _checked(folder, manifest["files"])
    try:
        values = {name: _value(folder / name, text) for name, text in texts.items()}
        pack: Pack = _packs.validate_python(_raw(manifest, values))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        _fail(folder, f"invalid pack: {'.'.join(map(str, first['loc']))}: {first['msg']}")
    except (LookupError, TypeError) as error:
        _fail(folder, f"invalid pack: {error}")
    faults = [
        Fault(f"experiment {experiment.id}", fault)
        for experiment in pack.experiments
        for fault in setting_faults(experiment.agent, experiment.settings)
    ]
    if faults:
        raise FileError(str(folder / "experiments.json"), faults)
    if pack.digest != manifest["digest"]:
        _fail(folder / MANIFEST, f"digest: expected {pack.digest}, found {manifest['digest']}")
    if digest is not None and pack.digest != digest:
        _fail(folder, f"another pack: expected the digest {digest}, found {pack.digest}")
    return pack


def _other_content(folder: Path) -> str:
    """Return the name of a file that is not of a pack, of any version, or nothing."""
    if not folder.is_dir():
        return folder.name
    names = {path.name for path in folder.iterdir()}
    if others := sorted(names - {MANIFEST, *FILES}):
        return others[0]
    try:
        manifest = _raw_manifest(folder) if names else {"format": FORMAT}
    except RobotouilleError:
        return MANIFEST
    found = manifest.get("format") if isinstance(manifest, dict) else None
    # Data sets of problems have a manifest, too.
    is_pack = isinstance(found, str) and found.startswith(FORMAT.rstrip("0123456789"))
    return "" if is_pack else MANIFEST


def _files(pack: Pack) -> dict[str, str]:
    """Return the texts of all files, the manifest last."""
    domain = json.dumps(json.loads(pack.domain), indent=1, ensure_ascii=False) + "\n"
    texts = {"domain.json": domain}
    for name in (*LISTS, OPTIONAL) if pack.figures else LISTS:
        texts[f"{name}.json"] = _lines(getattr(pack, name), name in WITH_PROBLEMS)
    manifest = {
        "format": FORMAT,
        "name": pack.name,
        "version": pack.version,
        "digest": pack.digest,
        "files": {name: _hash(text.encode()) for name, text in texts.items()},
    }
    return {**texts, MANIFEST: json.dumps(manifest, indent=2, ensure_ascii=False) + "\n"}


def _lines(parts: Iterable[Any], with_problems: bool) -> str:
    """Return a list as JSON, with a line for each entry, so that `diff` is useful."""
    rows = (fields_of(part) for part in parts)
    if with_problems:
        # One at a time, because decoded problems take several times the memory of their texts.
        rows = ({**row, "problem": json.loads(row["problem"])} for row in rows)
    lines = (json.dumps(row, ensure_ascii=False, default=fields_of) for row in rows)
    return "[\n" + ",\n".join(lines) + "\n]\n"


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _raw_manifest(folder: Path) -> Any:
    path = folder / MANIFEST
    return parse_json(_read(path, MAX_PACK_BYTES).decode(errors="replace"), str(path))


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    if not is_file(path):
        hint = did_you_mean(folder.name, _neighbours(folder))
        if is_file(folder / "domain/robotouille.json"):
            hint = f"; convert a checkout with `robotouille pack import {folder}`"
        _fail(folder, f"not a pack: it has no {MANIFEST}{hint}")
    manifest = _raw_manifest(folder)
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        found = manifest.get("format") if isinstance(manifest, dict) else manifest
        _fail(path, f"format: expected {FORMAT!r}, found {found!r}; build the pack again")
    files = manifest.get("files")
    if not isinstance(files, dict) or not files.keys() <= set(FILES):
        _fail(path, f"files: expected file names with their hashes, of {', '.join(FILES)}")
    for key in ("name", "version", "digest"):
        if not isinstance(manifest.get(key), str):
            _fail(path, f"{key}: expected a text, found {manifest.get(key)!r}")
    return manifest


def _neighbours(folder: Path) -> list[str]:
    with suppress(OSError):
        return [path.parent.name for path in folder.parent.glob(f"*/{MANIFEST}")]
    return []


def _checked(folder: Path, hashes: dict[str, str]) -> dict[str, str]:
    """Return the texts of all files, or raise FileError for missing or changed ones."""
    texts: dict[str, str] = {}
    faults: list[Fault] = []
    left = MAX_PACK_BYTES
    for name, expected in hashes.items():
        path = folder / name
        if not is_file(path):
            faults.append(Fault(name, "is missing"))
            continue
        content = _read(path, left)
        left -= len(content)
        if _hash(content) != expected:
            faults.append(Fault(name, "was changed since the pack was made"))
        else:
            texts[name] = content.decode(errors="replace")
    if faults:
        raise FileError(str(folder), faults)
    size = PackSize(folder)
    for text in texts.values():
        size.add(text)
    return texts


def _value(path: Path, text: str) -> Any:
    return parse_json(text, str(path), MAX_PACK_VALUES)


def _read(path: Path, most: int) -> bytes:
    try:
        if path.stat().st_size > most:
            _fail(path, f"the pack is larger than {MAX_PACK_BYTES:,} bytes")
        return read_bytes(path, most)
    except OSError as error:
        _fail(path, f"cannot be read: {error.strerror or error}")


def _raw(manifest: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a pack, with JSON values converted to texts."""
    raw: dict[str, Any] = {name: values[f"{name}.json"] for name in LISTS}
    raw[OPTIONAL] = values.get(f"{OPTIONAL}.json", [])
    for name in WITH_PROBLEMS:
        raw[name] = [{**row, "problem": canonical_json(row["problem"])} for row in raw[name]]
    domain = canonical_json(values["domain.json"])
    return {**raw, "domain": domain, "name": manifest["name"], "version": manifest["version"]}


def _fail(path: Path, message: str) -> NoReturn:
    raise FileError(str(path), [Fault("", message)])
