"""Built-in packs: the shipped tasks, their generated instances, and plans from certificates.

The shifts are a pack of their own, because a pack has one domain.

Ids look like paths: `asynchronous/06_potato_soup/free-252` is the layout for the seed 252, and
`…/default` is the task's own layout. Published ids (`asynchronous/5_potato_soup_252`) never have a
second slash, so the two cannot be confused. Unlike `#`, `@` and `:`, slashes are safe in URLs.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

from robotouille import Task, World, load_task, task_names
from robotouille.certification.certificate import certificate_path, read_certificate
from robotouille.certification.dataset import SUFFIX
from robotouille.domain.json_files import read_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.reading import is_file
from robotouille.generation.generator import paper_tasks
from robotouille.installation import data_folder
from robotouille.planning import read_plan
from robotouille_evaluation.packs.example_episodes import (
    ExampleChoice,
    episodes_by_form,
    example_sets,
)
from robotouille_evaluation.packs.pack import (
    Examples,
    InstanceKind,
    KnownPlan,
    Pack,
    PackInstance,
    PackTask,
    Prompt,
    canonical_json,
)

NAMES = (
    *("react", "react-plan", "react-rules", "react-talk", "joint"),
    *("plag", "io", "io-cot", "reflect", "rules"),
)
BETWEEN = "\n---\n"
PLACEHOLDERS = ("kitchen", "rules", "shift")


def own_prompts(domain: DomainFile, *, shifts: bool = False) -> tuple[Prompt, ...]:
    """Return all prompts; `rules` has instructions only.

    Args:
        shifts: Explain shifts below the explanation of kitchens.
    """
    return tuple(_prompt(name, domain, shifts) for name in NAMES)


def _prompt(name: str, domain: DomainFile, shifts: bool) -> Prompt:
    system, between, instructions = _text(name).partition(BETWEEN)
    if not between:
        system, instructions = "", system
    if shifts:
        instructions = instructions.replace("{kitchen}", "{kitchen}\n\n{shift}")
    for word in PLACEHOLDERS:
        instructions = instructions.replace(f"{{{word}}}", _text(word))
    actions = "\n".join(f"- {action.language_description}" for action in domain.action_defs)
    return Prompt(name, system, instructions.replace("{actions}", actions))


def _text(name: str) -> str:
    return (files(__package__) / "prompts" / f"{name}.md").read_text(encoding="utf-8").strip()


def own_examples(*datasets: str) -> tuple[Examples, ...]:
    """Return examples by form of answer, such as `synchronous/react`, of some or all datasets."""
    raw = json.loads((files(__package__) / "prompts/examples.json").read_text(encoding="utf-8"))
    found: list[Examples] = []
    for dataset, example in raw.items():
        if not datasets or dataset in datasets:
            task = example["task"]
            choices = _training_choices(task, example["reasoning"])
            found += example_sets(dataset, [episodes_by_form(task, choices)])
    return tuple(found)


def _training_choices(name: str, reasoning: list[str]) -> list[ExampleChoice]:
    """Return the choices of the plan of a training task."""
    world = World(load_task(name))
    path = data_folder("problems") / f"{name}.plan"
    plan = read_plan(path.read_text(encoding="utf-8"), world, str(path))
    choices, state = [], world.initial
    for step, thought in zip(plan, reasoning, strict=True):
        choices.append(ExampleChoice(state, step[0], thought))
        state = state.step(step[0]).state
    return choices


NAME, SHIFTS = "ours", "shifts"
VERSION = "1"
DOMAINS = {NAME: "robotouille", SHIFTS: "restaurant"}
"""Domains of the built-in packs."""
EXAMPLE_OF_SHIFTS = "asynchronous"
"""Data set whose examples show models that play shifts the form of answers."""

Progress = Callable[[int, int], None]
"""Called with the number of read tasks and of all."""


def build_own_pack(progress: Progress | None = None) -> Pack:
    """Return the built-in pack of the tasks with goals, which is built once per process.

    Raises:
        FileError: A shipped file is invalid.
    """
    return built_once(NAME, partial(_build, NAME, progress))


def build_shift_pack(progress: Progress | None = None) -> Pack:
    """Return the built-in pack of the shifts, which is built once per process.

    Raises:
        FileError: A shipped file is invalid.
    """
    return built_once(SHIFTS, partial(_build, SHIFTS, progress))


def pack_with(names: Iterable[str]) -> Pack:
    """Return the built-in pack with these data sets or tasks, by default `ours`.

    Raises:
        RobotouilleError: They belong to several packs.
    """
    shifts = [name for name in task_names() if name.startswith(f"{SHIFTS}/")]
    others = [name for name in task_names() if name not in shifts]

    def pack_of(name: str) -> str:
        # Parts of names may be given, too, if only shifts have them.
        part = any(name in task for task in shifts) and not any(name in task for task in others)
        return SHIFTS if name.partition("/")[0] == SHIFTS or part else NAME

    wanted = {pack_of(name) for name in names} or {NAME}
    if len(wanted) > 1:
        raise RobotouilleError(
            "shifts and tasks with goals are different packs: evaluate them in two runs"
        )
    (name,) = wanted
    return built_once(name, partial(_build, name, None))


def prompts_of(domain: DomainFile, *, shifts: bool = False) -> Pack:
    """Return a built-in pack's prompts and examples, without tasks, which take seconds to read."""
    prompts = own_prompts(domain, shifts=shifts)
    examples = own_examples(EXAMPLE_OF_SHIFTS) if shifts else own_examples()
    name = SHIFTS if shifts else NAME
    return Pack(name, VERSION, canonical_domain(domain), (), (), prompts, examples)


_built: dict[str, Pack] = {}


def built_once(name: str, build: Callable[[], Pack]) -> Pack:
    """Return the built-in pack with a name, which is built in the first call."""
    if name not in _built:
        _built[name] = build()
    return _built[name]


def _build(pack: str, progress: Progress | None) -> Pack:
    tasks: list[PackTask] = []
    instances: list[PackInstance] = []
    shifts = pack == SHIFTS
    names = (
        tuple(n for n in task_names() if n.startswith(f"{SHIFTS}/")) if shifts else paper_tasks()
    )
    domain = read_domain(DOMAINS[pack])
    for number, name in enumerate(names, start=1):
        found = [_default(name, domain), *sorted(_generated(name, domain), key=_in_order)]
        optimal = found[0].optimal()
        proof = "" if optimal is None else "proven for the default layout"
        dataset = name.partition("/")[0]
        tasks.append(PackTask(name, dataset, found[0].problem, optimal, proof))
        instances += found
        if progress is not None:
            progress(number, len(names))
    bare = prompts_of(domain, shifts=shifts)
    return replace(bare, tasks=tuple(tasks), instances=tuple(instances))


def canonical_domain(domain: DomainFile) -> str:
    """Return the text of a domain for a pack."""
    return canonical_json(domain.model_dump(mode="json", by_alias=True, exclude_unset=True))


def instance_id(task: str, kind: InstanceKind, seed: int | None = None) -> str:
    """Return the id of a built-in instance."""
    return f"{task}/{kind}" if seed is None else f"{task}/{kind}-{seed}"


def _default(name: str, domain: DomainFile) -> PackInstance:
    path = data_folder("problems") / f"{name}.json"
    raw = read_json(path)
    task = _task(path, raw, domain)
    return _instance(path, raw, task, name, "default", None)


def _generated(name: str, domain: DomainFile) -> Iterator[PackInstance]:
    """Yield the instances of a task among the generated files, by the files' provenance."""
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
    """Yield the plans of the certificates next to a problem."""
    for seats in task.problem.seats or (task.seats,):
        found = _plan(path, replace(task, seats=seats))
        if found is not None:
            yield found


def _plan(path: Path, task: Task) -> KnownPlan | None:
    """Return the plan of a task's certificate, if there is one for exactly this task."""
    certificate_file = certificate_path(path, task)
    if not is_file(certificate_file):
        return None
    certificate = read_certificate(certificate_file)
    same = certificate.instance == replace(task, name=certificate.task).digest
    if certificate.plan is None or not same:
        return None
    return KnownPlan(task.seats, certificate.plan, certificate.bound)
