"""Import of a user's checkout of the published repository as a pack.

No part of that repository is in this project. Its domain, problems, prompts, examples and settings
come from the user's disk, and its instances from `layouts`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from robotouille.domain.json_files import parse_json, read_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task
from robotouille.errors import Fault, FileError
from robotouille.files.reading import is_file
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.pack import (
    ExampleEpisode,
    Examples,
    FigureData,
    Pack,
    PackInstance,
    PackTask,
    Prompt,
    canonical_json,
    fields_of,
)
from robotouille_evaluation.packs.published_configuration import (
    is_encodable,
    parse_episode,
    read_experiment,
    read_text,
    read_yaml,
    require_inside,
)
from robotouille_evaluation.packs.published_figures import NOTEBOOK, read_figures
from robotouille_evaluation.packs.published_layouts import generate_layout
from robotouille_evaluation.packs.store import PackSize

NAME = "published"
DOMAIN = "domain/robotouille.json"
PROBLEMS = "environments/env_generator/examples"
PROMPTS = "agents/prompt_builder/prompts"
EXAMPLES = "agents/in_context_examples/data"
CONFIGURATION = "conf"

DATASETS = ("synchronous", "asynchronous", "multi_agent")
TRAINING = ("synchronous_train", "asynchronous_train")
"""Data sets of the examples, which have only default instances."""

SEEDS = tuple(range(42, 421, 42))
"""Seeds of the paper's instances, which include the seeds of every experiment."""

MAX_FILES = 500
"""Maximum number of files of a kind in a folder."""

Progress = Callable[[int, int], None]
"""Called with the number of generated instances and of all."""


@dataclass(frozen=True, slots=True)
class ImportedCheckout:
    """Pack of a checkout, with missing parts and faults of files."""

    pack: Pack
    missing: tuple[str, ...]
    faults: tuple[str, ...]


@dataclass(slots=True)
class _Reading:
    """Checkout while it is read, with the size of its pack, missing parts and faults so far."""

    root: Path
    size: PackSize
    missing: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def files(self, folder: str, pattern: str) -> list[Path]:
        """Return the files of a folder, and note if it is missing or has files that are refused.

        Raises:
            FileError: The folder has more than `MAX_FILES` such files, leads outside the checkout
                or cannot be read.
        """
        require_inside(self.root / folder, self.root)
        try:
            files = (path for path in (self.root / folder).rglob(pattern) if is_file(path))
            found = sorted(islice(files, MAX_FILES + 1))
        except OSError as error:
            fault = Fault("", f"cannot be read: {error.strerror or error}")
            raise FileError(str(self.root / folder), [fault]) from None
        if len(found) > MAX_FILES:
            fault = Fault("", f"has more than {MAX_FILES:,} files {pattern}")
            raise FileError(str(self.root / folder), [fault])
        if not found:
            self.missing.append(folder)
        return [path for path in found if self._is_usable(path)]

    def _is_usable(self, path: Path) -> bool:
        try:
            require_inside(path, self.root)
            if not is_encodable(str(path.relative_to(self.root))):
                raise FileError(str(path), [Fault("", "the name is not UTF-8 text")])
        except FileError as error:
            self.failed(error)
            return False
        return True

    def failed(self, error: FileError) -> None:
        """Note the faults of a file."""
        self.faults += str(error).splitlines()

    def count(self, part: Prompt | ExampleEpisode | Experiment) -> None:
        """Count a part of the pack, or raise FileError if the pack becomes too large."""
        self.size.add(json.dumps(part, ensure_ascii=False, default=fields_of))


def read_checkout(
    root: Path, *, seeds: Sequence[int] = SEEDS, progress: Progress | None = None
) -> ImportedCheckout:
    """Read a checkout and generate free and noisy instances of each task for each seed.

    Raises:
        FileError: The folder is not a checkout, is one of an unknown version, or has too many
            files or too large ones for a pack.
        MissingExtraError: PyYAML is not installed.
    """
    raw_domain = _domain(root)
    domain = validate(raw_domain, DomainFile, str(root / DOMAIN))
    reading = _Reading(root, PackSize(root))
    experiments = tuple(_experiments(reading))
    prompts = tuple(_prompts(reading))
    examples = tuple(_examples(reading))
    problems = dict(_problems(reading, domain))
    if not problems:
        raise FileError(str(root / PROBLEMS), [Fault("", "no problem of the benchmark found")])
    tasks = tuple(_task(name, problem, experiments) for name, problem in problems.items())
    instances = tuple(_instances(problems, seeds, reading, progress))
    pack = Pack(
        NAME,
        domain.version,
        canonical_json(raw_domain),
        tasks,
        instances,
        prompts,
        examples,
        experiments,
        _figures(reading),
    )
    reading.missing += _unmet(pack)
    return ImportedCheckout(
        pack, tuple(dict.fromkeys(reading.missing)), tuple(dict.fromkeys(reading.faults))
    )


def _domain(root: Path) -> dict[str, Any]:
    if not root.is_dir():
        raise FileError(str(root), [Fault("", "is not a folder")])
    absent = [
        part
        for part, found in (
            (DOMAIN, is_file(root / DOMAIN)),
            (PROBLEMS, (root / PROBLEMS).is_dir()),
        )
        if not found
    ]
    if absent:
        why = f"not a checkout of the published repository: it has no {' and no '.join(absent)}"
        raise FileError(str(root), [Fault("", why)])
    require_inside(root / DOMAIN, root)
    domain = read_json(root / DOMAIN)
    if not isinstance(domain, dict) or not {"predicate_defs", "action_defs"} <= domain.keys():
        why = "expected a domain with predicate_defs and action_defs; is it another version?"
        raise FileError(str(root / DOMAIN), [Fault("", why)])
    return domain


# Problems and instances


def _problems(reading: _Reading, domain: DomainFile) -> Iterator[tuple[str, str]]:
    """Yield the names and texts of the problems of each data set in the order of their numbers."""
    for dataset in (*DATASETS, *TRAINING):
        for path in sorted(reading.files(f"{PROBLEMS}/{dataset}", "*.json"), key=_in_order):
            try:
                raw = read_json(path)
                problem = validate(raw, ProblemFile, str(path))
                build_task(path.stem, domain, problem, source=str(path))
            except FileError as error:
                reading.failed(error)
            else:
                text = canonical_json(raw)
                reading.size.add(text)
                yield f"{dataset}/{path.stem}", text


def _in_order(path: Path) -> tuple[float, str]:
    number = re.match(r"\d+(?:\.\d+)?(?=_)", path.stem)
    return (float(number[0]) if number else float("inf"), path.stem)


def _task(name: str, problem: str, experiments: Sequence[Experiment]) -> PackTask:
    """Return a task with the constant of the first experiment that plays it."""
    constants = (
        (experiment.id, steps)
        for experiment in experiments
        for task, steps in zip(experiment.tasks, experiment.optimal_steps, strict=True)
        if task == name
    )
    source, optimal = next(constants, ("", None))
    where = f"constant in {source}" if source else ""
    return PackTask(name, name.partition("/")[0], problem, optimal, where)


def _instances(
    problems: dict[str, str],
    seeds: Sequence[int],
    reading: _Reading,
    progress: Progress | None,
) -> Iterator[PackInstance]:
    evaluated = [name for name in problems if name.partition("/")[0] in DATASETS]
    total, made = 2 * len(evaluated) * len(seeds), 0
    for name, problem in problems.items():
        raw = parse_json(problem, name)
        seats = len(raw.get("players", []))
        reading.size.add(problem)
        yield PackInstance(name, name, "default", None, None, problem, seats)
        for noisy in (False, True) if name in evaluated else ():
            for seed in seeds:
                try:
                    instance = _instance(name, raw, seed, noisy)
                except FileError as error:
                    reading.failed(error)
                else:
                    reading.size.add(instance.problem)
                    yield instance
                made += 1
                if progress is not None:
                    progress(made, total)


def _instance(name: str, raw: dict[str, Any], seed: int, noisy: bool) -> PackInstance:
    layout = generate_layout(raw, seed, noisy=noisy, source=name)
    problem, used = canonical_json(layout.problem), layout.seed_used
    if noisy:
        return PackInstance(f"{name}_{seed}_noisy", name, "noisy", seed, used, problem)
    return PackInstance(f"{name}_{seed}", name, "free", seed, used, problem)


# Prompts, examples and experiments


def _prompts(reading: _Reading) -> Iterator[Prompt]:
    for path in reading.files(PROMPTS, "*.yml"):
        try:
            raw = read_yaml(path, reading.root)
            texts = {key: raw.get(key) for key in ("system", "instructions")}
            for key, text in texts.items():
                if not isinstance(text, str):
                    raise FileError(str(path), [Fault(key, "expected a text")])
            id_ = path.relative_to(reading.root / PROMPTS).with_suffix("").as_posix()
            prompt = Prompt(id_, *(str(text).strip() for text in texts.values()))
        except FileError as error:
            reading.failed(error)
        else:
            reading.count(prompt)
            yield prompt


def _examples(reading: _Reading) -> Iterator[Examples]:
    files = reading.files(EXAMPLES, "*.txt")
    for folder in dict.fromkeys(path.parent for path in files):
        episodes = _episodes(reading, [path for path in files if path.parent == folder])
        if episodes:
            yield Examples(folder.relative_to(reading.root / EXAMPLES).as_posix(), episodes)


def _episodes(reading: _Reading, paths: Sequence[Path]) -> tuple[ExampleEpisode, ...]:
    """Return the example files of a folder, in order; none if one is invalid."""
    episodes = []
    for path in paths:
        try:
            episode = parse_episode(read_text(path, reading.root), path.stem, str(path))
        except FileError as error:
            reading.failed(error)
            return ()
        reading.count(episode)
        episodes.append(episode)
    return tuple(episodes)


def _experiments(reading: _Reading) -> Iterator[Experiment]:
    conf = reading.root / CONFIGURATION
    for path in reading.files(f"{CONFIGURATION}/experiments", "*.yaml"):
        try:
            experiment = read_experiment(conf, path)
        except FileError as error:
            reading.failed(error)
        else:
            if experiment is not None:
                reading.count(experiment)
                yield experiment


def _figures(reading: _Reading) -> tuple[FigureData, ...]:
    try:
        found = read_figures(reading.root)
    except FileError as error:
        reading.failed(error)
        return ()
    if not found:
        reading.missing.append(NOTEBOOK)
    return found


def _unmet(pack: Pack) -> Iterator[str]:
    """Yield the files that experiments need and the pack lacks."""
    prompts = {prompt.id for prompt in pack.prompts}
    examples = {found.name for found in pack.examples}
    for experiment in pack.experiments:
        yield from (f"{PROBLEMS}/{name}.json" for name in pack.missing_tasks(experiment))
        yield from (f"{EXAMPLES}/{name}" for name in experiment.shown if name not in examples)
        yield from (f"{PROMPTS}/{id_}.yml" for id_ in experiment.prompt_ids if id_ not in prompts)
