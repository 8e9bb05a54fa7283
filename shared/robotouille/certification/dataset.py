"""Data sets: folders of problem files with their certificates and a manifest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from robotouille.certification.certificate import (
    Certificate,
    ContentHash,
    Count,
    Flag,
    certificate_path,
    content_hash,
    json_text,
    read_certificate,
)
from robotouille.domain.json_files import read_json
from robotouille.domain.loading import load_task
from robotouille.domain.schema import Schema
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.reading import read_bytes
from robotouille.planning.plan import Proof

MANIFEST = "manifest.json"
SUFFIX = ".certificate.json"


@dataclass(frozen=True, slots=True, order=True)
class DatasetEntry:
    """A problem file with a number of seats. Paths are relative to the dataset's folder."""

    file: str
    seats: int
    certificate: str

    def __str__(self) -> str:
        return self.certificate.removesuffix(SUFFIX)


@dataclass(frozen=True, slots=True)
class Dataset:
    """The instances in a folder, sorted, and the faults of other files."""

    folder: Path
    instances: tuple[DatasetEntry, ...]
    faults: tuple[str, ...]

    def task(self, instance: DatasetEntry) -> Task:
        """Return the task of an instance.

        Raises:
            FileError: The problem file is invalid.
            UnknownTaskError: The problem file does not exist.
        """
        return load_task(str(self.folder / instance.file), seats=instance.seats)

    def certificate(self, instance: DatasetEntry) -> Certificate:
        """Return the certificate of an instance without checking its claims.

        Raises:
            FileError: The file is missing, or its format is invalid.
        """
        path = self.folder / instance.certificate
        certificate = read_certificate(path)
        if read_bytes(path) != json_text(certificate).encode():
            raise FileError(str(path), [Fault("", "is not in the format of certificates")])
        return certificate


def read_dataset(folder: Path) -> Dataset:
    """Find the problem files in a folder and its subfolders.

    Domains, renderings, input files, certificates and manifests are ignored.

    Raises:
        FileError: There are no problem files.
    """
    if not folder.is_dir():
        raise FileError(str(folder), [Fault("", "is not a folder")])
    instances: list[DatasetEntry] = []
    faults: list[str] = []
    certificates: dict[str, str] = {}
    for path in sorted(folder.rglob("*.json")):
        try:
            for each in _instances(path, folder):
                other = certificates.setdefault(each.certificate, each.file)
                if other == each.file:
                    instances.append(each)
                else:
                    # "soup.json" with two seats, and "soup@2.json" with one.
                    faults.append(f"{path}: its certificate would be that of {other}; rename one")
        except RobotouilleError as error:
            faults += str(error).splitlines()
    if not instances and not faults:
        raise FileError(str(folder), [Fault("", "the folder has no problem files")])
    return Dataset(folder, tuple(sorted(instances)), tuple(faults))


def _instances(path: Path, folder: Path) -> Iterator[DatasetEntry]:
    if path.name == MANIFEST or path.name.endswith(SUFFIX):
        return
    raw = read_json(path)
    keys = set(raw) if isinstance(raw, dict) else set()
    others = {"action_defs", "keyboard_actions", "mouse_click_actions"}
    if keys & others or ("floor" in keys and "goal" not in keys):
        return
    task = load_task(str(path))
    for seats in task.problem.seats or (task.seats,):
        name = certificate_path(path, load_task(str(path), seats=seats))
        relative = [p.relative_to(folder).as_posix() for p in (path, name)]
        yield DatasetEntry(relative[0], seats, relative[1])


class DatasetRow(Schema):
    """An instance in a manifest: its files with their hashes, and the proven result."""

    file: str
    seats: Count
    file_hash: ContentHash
    instance: ContentHash
    certificate: str
    certificate_hash: ContentHash
    length: Count | None
    bound: Count
    optimal: Flag
    proof: Proof


class Manifest(Schema):
    """All certified instances of a data set, sorted by file and seats."""

    format: Literal["robotouille-dataset/1"]
    instances: tuple[DatasetRow, ...]


def _row(dataset: Dataset, instance: DatasetEntry, certificate: Certificate) -> DatasetRow:
    return DatasetRow(
        file=instance.file,
        seats=instance.seats,
        file_hash=content_hash(read_bytes(dataset.folder / instance.file)),
        instance=certificate.instance,
        certificate=instance.certificate,
        certificate_hash=content_hash(json_text(certificate).encode()),
        length=certificate.length,
        bound=certificate.bound,
        optimal=certificate.optimal,
        proof=certificate.proof,
    )


def manifest_of(dataset: Dataset, certificates: dict[DatasetEntry, Certificate]) -> Manifest:
    rows = tuple(_row(dataset, i, certificates[i]) for i in sorted(certificates))
    return Manifest(format="robotouille-dataset/1", instances=rows)


@dataclass(frozen=True, slots=True)
class CertifyingOutcome:
    """The result for an instance: a certificate or a fault. `kept` means that it existed before."""

    instance: DatasetEntry
    certificate: Certificate | None
    fault: str = ""
    kept: bool = False


@dataclass(frozen=True, slots=True)
class Running:
    """A running search: expansions, bound, and length of the best plan so far."""

    instance: DatasetEntry
    expansions: int
    bound: int
    length: int | None


Tell = Callable[[Sequence[CertifyingOutcome], int, Sequence[Running]], None]
"""Progress callback: finished outcomes, the number of instances, and running searches."""


@dataclass(frozen=True, slots=True)
class DatasetReport:
    """The outcomes of all instances, sorted, and all faults."""

    outcomes: tuple[CertifyingOutcome, ...]
    faults: tuple[str, ...]

    @property
    def certificates(self) -> dict[DatasetEntry, Certificate]:
        return {o.instance: o.certificate for o in self.outcomes if o.certificate is not None}


def report_of(
    dataset: Dataset, outcomes: Sequence[CertifyingOutcome], *faults: str
) -> DatasetReport:
    ordered = tuple(sorted(outcomes, key=lambda outcome: outcome.instance))
    failed = tuple(outcome.fault for outcome in ordered if outcome.fault)
    return DatasetReport(ordered, (*dataset.faults, *failed, *faults))
