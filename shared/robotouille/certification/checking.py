"""Check the certificates and the manifest of a dataset, and prove a sample of bounds again."""

from __future__ import annotations

import random
from pathlib import Path

from robotouille.certification.certificate import Certificate, Solver, check, json_text, prove_again
from robotouille.certification.dataset import (
    MANIFEST,
    SUFFIX,
    CertifyingOutcome,
    Dataset,
    DatasetEntry,
    DatasetReport,
    Manifest,
    Row,
    Tell,
    manifest_of,
    read_dataset,
    report_of,
)
from robotouille.domain.files import parse_json, validate
from robotouille.errors import FileError, RobotouilleError

__all__ = ["check_dataset"]


def check_dataset(
    folder: Path,
    solver: Solver,
    *,
    sample: int = 0,
    seed: int = 0,
    seconds: float | None = None,
    tell: Tell | None = None,
) -> DatasetReport:
    """Check every certificate of a folder and its manifest: hashes, plans, claims.

    What is wrong is in the report.

    Args:
        solver: Proves bounds again.
        sample: How many bounds, chosen by `seed`, are proven again under the budgets of their
            certificates.
        seconds: How long each of these proofs may take at most; None: as long as it does.
        tell: Is called now and then with what is done.

    Raises:
        FileError: There is nothing to check.
        RobotouilleError: An answer of the solver does not hold, or it cannot be asked.
    """
    dataset = read_dataset(folder)
    outcomes: list[CertifyingOutcome] = []
    for instance in dataset.instances:
        outcomes.append(_checked(dataset, instance))
        if tell is not None:
            tell(outcomes, len(dataset.instances), ())
    valid = report_of(dataset, outcomes).certificates
    faults = [*_stray_faults(dataset), *_manifest_faults(dataset, valid)]
    for instance in random.Random(seed).sample(sorted(valid), min(sample, len(valid))):
        found = valid[instance]
        limits = found.limits.model_copy(update={"seconds": seconds}).limits()
        if not prove_again(found, dataset.task(instance), solver, limits):
            faults.append(f"{folder / instance.certificate}: the bound is not proven again")
    return report_of(dataset, outcomes, *faults)


def _checked(dataset: Dataset, instance: DatasetEntry) -> CertifyingOutcome:
    path = dataset.folder / instance.certificate
    try:
        certificate = dataset.certificate(instance)
        problems = check(certificate, dataset.task(instance))
    except RobotouilleError as error:
        return CertifyingOutcome(instance, None, str(error))
    if problems:
        return CertifyingOutcome(
            instance, None, "\n".join(f"{path}: {problem}" for problem in problems)
        )
    return CertifyingOutcome(instance, certificate, kept=True)


def _stray_faults(dataset: Dataset) -> list[str]:
    known = {dataset.folder / instance.certificate for instance in dataset.instances}
    found = set(dataset.folder.rglob(f"*{SUFFIX}"))
    return [f"{path}: belongs to no problem file" for path in sorted(found - known)]


def _manifest_faults(dataset: Dataset, valid: dict[DatasetEntry, Certificate]) -> list[str]:
    path = dataset.folder / MANIFEST
    try:
        text = path.read_text(encoding="utf-8")
        manifest = validate(parse_json(text, str(path)), Manifest, str(path))
    except (OSError, UnicodeDecodeError) as error:
        return [f"{path}: cannot be read: {error}"]
    except FileError as error:
        return [str(error)]
    found = {row.certificate: row for row in manifest.instances}
    listed = {instance.certificate for instance in dataset.instances}
    faults = [
        f"{path}: {name}: there is no such instance" for name in sorted(found.keys() - listed)
    ]
    for row in manifest_of(dataset, valid).instances:
        faults += _differences(row, found.get(row.certificate), str(path))
    whole = len(valid) == len(dataset.instances)
    if whole and not faults and text != json_text(manifest_of(dataset, valid)):
        faults.append(f"{path}: is not written as manifests are")
    return faults


def _differences(row: Row, found: Row | None, path: str) -> list[str]:
    if found is None:
        return [f"{path}: {row.certificate}: is missing"]
    return [
        f"{path}: {row.certificate}: {name}: expected {value}, found {getattr(found, name)}"
        for name, value in row
        if getattr(found, name) != value
    ]
