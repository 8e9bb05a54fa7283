"""Our pack: the shipped tasks, their generated instances, and what certificates prove of them.

Ids look like paths: `asynchronous/06_potato_soup/free-252` is a layout drawn for the seed 252, and
`…/default` the task's own. A published id (`asynchronous/5_potato_soup_252`) never has a second
slash, so neither can be taken for the other; and ours is a good file name and a good URL as it is,
which `#`, `@` and `:` would not be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from robotouille import Task
from robotouille.certification.certificate import certificate_path, read_certificate
from robotouille.certification.dataset import SUFFIX
from robotouille.domain.files import is_file, read_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain
from robotouille.errors import Fault, FileError
from robotouille.generation.paper_instances import paper_tasks
from robotouille.resources import data_folder
from robotouille_evaluation.packs.pack import (
    InstanceKind,
    KnownPlan,
    Pack,
    PackInstance,
    PackTask,
    canonical_json,
)
from robotouille_evaluation.packs.prompting import own_examples, own_prompts

__all__ = ["build_own_pack", "instance_id"]

NAME = "ours"
VERSION = "1"
DOMAIN = "robotouille"

Progress = Callable[[int, int], None]
"""Called with the number of tasks that are read, and of all."""


def build_own_pack(progress: Progress | None = None) -> Pack:
    """The pack of the shipped files: built once in a process, since these do not change.

    Raises:
        FileError: A shipped file has faults.
    """
    if not _built:
        _built.append(_build(progress))
    return _built[0]


_built: list[Pack] = []


def _build(progress: Progress | None) -> Pack:
    tasks: list[PackTask] = []
    instances: list[PackInstance] = []
    names = paper_tasks()
    domain = read_domain(DOMAIN)
    for number, name in enumerate(names, start=1):
        found = [_default(name, domain), *sorted(_generated(name, domain), key=_in_order)]
        optimal = found[0].optimal()
        proof = "" if optimal is None else "proven for the default layout"
        dataset = name.partition("/")[0]
        tasks.append(PackTask(name, dataset, found[0].problem, optimal, proof))
        instances += found
        if progress is not None:
            progress(number, len(names))
    text = canonical_json(domain.model_dump(mode="json", by_alias=True, exclude_unset=True))
    told = own_prompts(domain), own_examples()
    return Pack(NAME, VERSION, text, tuple(tasks), tuple(instances), *told)


def instance_id(task: str, kind: InstanceKind, seed: int | None = None) -> str:
    """What an instance of ours is called; see the module."""
    return f"{task}/{kind}" if seed is None else f"{task}/{kind}-{seed}"


def _default(name: str, domain: DomainFile) -> PackInstance:
    path = data_folder("problems") / f"{name}.json"
    raw = read_json(path)
    task = _task(path, raw, domain)
    return _instance(path, raw, task, name, "default", None)


def _generated(name: str, domain: DomainFile) -> Iterator[PackInstance]:
    """The instances of a task among the generated files, by what these say of themselves."""
    folder = data_folder("problems") / "generated" / name.partition("/")[0]
    for path in folder.glob(f"{name.partition('/')[2]}_*.json"):
        if not path.name.endswith(SUFFIX):
            raw = read_json(path)
            task = _task(path, raw, domain)
            provenance = task.problem.provenance
            if provenance is not None and provenance.source == name:
                kind = _kind(path, provenance.kind)
                yield _instance(path, raw, task, name, kind, provenance.seed)


def _task(path: Path, raw: Any, domain: DomainFile) -> Task:
    problem = validate(raw, ProblemFile, str(path))
    return build_task(path.stem, domain, problem, source=str(path))


def _instance(
    path: Path, raw: Any, task: Task, name: str, kind: InstanceKind, seed: int | None
) -> PackInstance:
    id_, plans = instance_id(name, kind, seed), tuple(_plans(path, task))
    return PackInstance(id_, name, kind, seed, seed, canonical_json(raw), task.seats, plans)


def _kind(path: Path, name: str) -> InstanceKind:
    kinds: tuple[InstanceKind, ...] = get_args(InstanceKind)
    for kind in kinds:
        if kind == name:
            return kind
    raise FileError(str(path), [Fault("provenance.kind", f"expected one of {kinds}, is {name!r}")])


def _in_order(instance: PackInstance) -> tuple[bool, int]:
    return instance.kind == "noisy", instance.seed or 0


def _plans(path: Path, task: Task) -> Iterator[KnownPlan]:
    """The plans of certificates beside a problem."""
    for seats in task.problem.seats or (task.seats,):
        found = _plan(path, replace(task, seats=seats))
        if found is not None:
            yield found


def _plan(path: Path, task: Task) -> KnownPlan | None:
    """The plan of a task's certificate; None if it has none, or is of another task."""
    certificate_file = certificate_path(path, task)
    if not is_file(certificate_file):
        return None
    certificate = read_certificate(certificate_file)
    same = certificate.instance == replace(task, name=certificate.task).digest
    if certificate.plan is None or not same:
        return None
    return KnownPlan(task.seats, certificate.plan, certificate.bound)
