"""Checks of domains and problems that load but cannot work, and of the files that belong to them.

Reachability is tested in the delete relaxation: facts are never removed, delays pass at once, and
objects are created as soon as possible. Anything unreachable there is truly unreachable.

A kitchen can be played without its input file and its rendering, so most findings about those two
are warnings (a named file or picture is missing) or notes (what the window uses instead).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Set
from dataclasses import replace
from itertools import islice, product
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from robotouille.domain.derived import created_kinds, fluents
from robotouille.domain.domain_checks import check_domain, check_input
from robotouille.domain.input_bindings import INPUT_FILES, made_up_keys
from robotouille.domain.json_files import as_in_file, known_part, read_json
from robotouille.domain.loading import load_task
from robotouille.domain.problem_checks import check_kinds, check_problem
from robotouille.domain.related_files import (
    faults_in_extending_file,
    input_path,
    read_extending,
    rendering_path,
)
from robotouille.domain.rendering import RENDERING_FILES
from robotouille.domain.schema import (
    ActionDef,
    Creation,
    DomainFile,
    EffectDef,
    InputFile,
    ProblemFile,
)
from robotouille.domain.task import (
    DOMAIN_FILES,
    Task,
    complete_domain,
    domain_named_in,
    read_domain,
    resolve_wildcards,
)
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.installation import data_folder
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.atoms import EXISTS, USED
from robotouille.world.grounding.objects import Object, bound, places_in_problem
from robotouille.world.lint_renderings import lint_names, lint_pictures
from robotouille.world.lint_wording import lint_wording
from robotouille.world.scene import scene
from robotouille.world.world import World


def lint_companions(
    domain: DomainFile, beside: Path | None, kinds: Iterable[str] = ()
) -> list[Fault]:
    """Check the input file and the rendering of a domain, next to a file or shipped.

    `kinds` are the kinds of a problem's objects.
    """
    return [*_inputs(domain, beside), *_rendering(domain, beside, kinds)]


def lint_input(inputs: InputFile, domain: DomainFile, name: str) -> list[Fault]:
    """Report names that the domain does not have, and actions that the file does not name."""
    faults = check_input(inputs, domain)
    for action, key in made_up_keys(inputs, domain).items():
        unbound = f"{action!r} has no click and no key in {name}: {key.upper()} is used"
        message = f"{unbound}; to choose another, add it to {domain.name}.input.json"
        faults.append(Fault("keyboard_actions", message, "note"))
    return faults


def _is_own(domain: DomainFile, path: Path) -> bool:
    """Return whether a rendering is the domain's own, not the kitchen's in its place."""
    named = Path(domain.rendering_json or "").name
    return path.name in (named, f"{domain.name}.json", f"{domain.name}.rendering.json")


def _inputs(domain: DomainFile, beside: Path | None) -> Iterator[Fault]:
    path = input_path(domain, beside)
    if path is None:
        if domain.input_json is not None:
            yield _missing("input_json", domain.input_json, "all keys are chosen automatically")
        return
    try:
        faults = lint_input(read_extending(path, INPUT_FILES), domain, path.name)
    except FileError as error:
        faults = list(error.faults)
    yield from _in(path, faults)


def _rendering(domain: DomainFile, beside: Path | None, kinds: Iterable[str]) -> Iterator[Fault]:
    path = rendering_path(domain, beside)
    own = _is_own(domain, path)
    if not own and domain.rendering_json is not None:
        yield _missing("rendering_json", domain.rendering_json, "it looks like the kitchen")
    try:
        rendering = read_extending(path, RENDERING_FILES)
    except FileError as error:
        yield from _in(path, error.faults)
        return
    yield from _in(path, lint_pictures(rendering, beside))
    if not own:
        return
    if path.parent != data_folder("renderings"):
        yield from _in(path, lint_names(path, rendering, domain, beside, kinds))
    # Shipped renderings are not to be changed: name a file of the domain's own instead.
    file = path.name if path.parent == beside else f"{domain.name}.rendering.json"
    needed = dict.fromkeys((*kinds, *created_kinds(domain)))
    for kind in needed:
        if not rendering.shows(kind):
            words = f"{kind!r} has no picture, so a tile with its name is drawn: "
            yield Fault("", f"{words}add one to {file}", "note")


def _missing(field: str, name: str, result: str) -> Fault:
    message = f"there is no file {Path(name).name!r} next to it or shipped, so {result}"
    return Fault(field, f"{message}: write the file or remove the field", "warning")


def _in(path: Path, faults: Iterable[Fault]) -> Iterator[Fault]:
    """Yield findings with the name of the file they are about."""
    for fault in faults:
        file = f"{path.resolve().parent.name}/{path.name}"
        place = f"{file}: {fault.path}" if fault.path else file
        yield Fault(place, fault.message, fault.severity)


def lint_problem_file(path: Path, domain: str | None = None) -> list[Fault]:
    """Check a problem, its domain and the files that belong to the domain.

    Faults of the problem do not hide those of the others.

    Raises:
        FileError: The file is not JSON.
    """
    raw = read_json(path)
    try:
        task = load_task(str(path), domain=domain)
        faults = [*lint_task(task), *_placement_of_more(path, task, domain)]
        return as_in_file(faults, raw)
    except FileError as error:
        faults = faults_for(path, error)
    named = raw.get("domain") if isinstance(raw, dict) else None
    try:
        used = complete_domain(
            read_domain(domain, path.parent)
            if domain
            else domain_named_in(path, named and str(named))
        )
    except FileError as error:
        faults += faults_for(path, error)
    else:
        problem = known_part(raw, ProblemFile)
        kinds: list[str] = []
        if problem is not None:
            problem = resolve_wildcards(problem, used, seed=0)
            found = [*check_problem(problem, used), *check_kinds(problem, used)]
            faults += as_in_file(found, raw)
            kinds = [thing.name for things in problem.objects.values() for thing in things]
        faults += [*lint_domain(used), *lint_companions(used, path.parent, kinds)]
    return list(dict.fromkeys(faults))


def _placement_of_more(path: Path, task: Task, domain: str | None) -> Iterator[Fault]:
    """Report players in wrong places whom the task has only with more seats than by default."""
    # Players are numbered by their places, so their names depend on the seats.
    known = {fault.message for fault in _placement(World(task))}
    for seats in task.problem.seats or ():
        for fault in _placement(World(load_task(str(path), seats=seats, domain=domain))):
            if fault.message not in known:
                known.add(fault.message)
                yield replace(fault, message=f"{fault.message} ({seats} seats)")


def faults_for(path: Path, error: FileError) -> list[Fault]:
    """Return an error's faults, with the name of the file if it is not the one being checked."""
    other = Path(error.file).name
    if not error.file.endswith(".json") or other == path.with_suffix(".json").name:
        return list(error.faults)
    return [Fault(f"{other}: {f.path}", f.message, f.severity) for f in error.faults]


def lint_domain_file(path: Path) -> list[Fault]:
    """Check a domain file, and, if it has no errors, the files that belong to it.

    Raises:
        FileError: The file is not JSON, or a file that it extends is invalid.
    """
    raw = read_json(path)
    try:
        domain = complete_domain(read_domain(str(path)))
    except FileError as error:
        known = known_part(raw, DomainFile)
        more = check_domain(known) if known else []
        return list(dict.fromkeys([*faults_for(path, error), *more]))
    whole = domain.model_dump(mode="json")
    faults = lint_domain(domain)
    if raw.get("extends") is not None:
        faults = faults_in_extending_file(faults, raw, whole, DOMAIN_FILES)
    return faults + lint_companions(domain, path.parent)


def lint_domain(domain: DomainFile) -> list[Fault]:
    """Report actions that can never apply, whatever the problem, and invisible characters."""
    changing = fluents(domain)
    implied = {rule.predicate for rule in domain.layout or ()}
    arity = {p.name: len(p.param_types) for p in domain.predicate_defs}
    faults = lint_wording(_as_json(domain))
    for i, action in enumerate(domain.action_defs):
        path = f"action_defs[{i}]"
        for predicate in _contradictions(action):
            message = f"{action.name!r} can never apply: it needs {predicate!r} both true and false"
            faults.append(Fault(path, message))
        for j, condition in enumerate(action.precons):
            name = condition.predicate
            given = name in changing or name in implied or arity[name] == 1
            if condition.is_true and not given:
                message = f"{action.name!r} can never apply: nothing makes {name!r} true"
                faults.append(Fault(f"{path}.precons[{j}]", message))
        faults += (Fault(f"{path}.{where}", words, "warning") for where, words in _lonely(action))
    return faults


def _as_json(model: BaseModel) -> Any:
    return model.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _lonely(action: ActionDef) -> Iterator[tuple[str, str]]:
    """Yield the preconditions whose only object occurs nowhere else in the action.

    Any object of the task could fulfil them, as for `isdough(i2)` in place of `isdough(i1)`.
    """
    text = action.model_dump_json()
    for j, condition in enumerate(action.precons):
        for name in condition.params if len(condition.params) == 1 else ():
            if text.count(f'"{name}"') == 1 and f"{{{name}}}" not in action.language_description:
                words = f"{name!r} occurs nowhere else in {action.name!r}, so any object will do"
                yield f"precons[{j}].params[0]", f"{words}; is another one meant?"


def _contradictions(action: ActionDef) -> list[str]:
    wanted = {(c.predicate, c.params, c.is_true) for c in action.precons}
    return sorted({p for p, params, true in wanted if true and (p, params, False) in wanted})


def lint_task(task: Task) -> list[Fault]:
    """Check a task for bad placements, unreachable stations, impossible goals and missing files."""
    world = World(task)
    placement = list(_placement(world))
    misplaced = {fault.path for fault in placement}
    kinds = dict.fromkeys(thing.kind for thing in world.placed)
    faults = [
        *(f for f in check_problem(task.problem, task.domain) if f.severity != "error"),
        *check_kinds(task.problem, task.domain),
        *lint_wording(_as_json(task.problem)),
        *lint_domain(task.domain),
        *placement,
        *_stations(world),
        *_invisible(world, misplaced),
        *lint_companions(task.domain, task.folder, kinds),
    ]
    # With objects in wrong places, goals look impossible for the wrong reason.
    if not any(fault.severity == "error" for fault in placement):
        faults += _goal(world)
    return faults


class _FaultOf:
    """Makes faults of objects, each with its place in the problem."""

    def __init__(self, world: World) -> None:
        self._places = places_in_problem(world.task)

    def __call__(self, name: str, message: str, severity: str = "error") -> Fault:
        """Return a fault that begins with the object's name."""
        return Fault(self.place(name), f"{name} {message}", severity)

    def place(self, name: str) -> str:
        """Return the place of an object in the problem; empty if it is created later."""
        return self._places.get(name, "")


def _placement(world: World) -> Iterator[Fault]:
    domain = world.task.domain
    fault = _FaultOf(world)
    stations = [o for o in world.placed if o.type in domain.station_types]
    tiles = Counter(o.tile for o in stations)
    for thing in stations:
        if tiles[thing.tile] > 1:
            others = ", ".join(o.name for o in stations if o.tile == thing.tile and o != thing)
            yield fault(thing.name, f"stands on the same tile {thing.tile} as {others}")
    blocked = {o.tile: o.name for o in stations}
    faced: dict[object, str] = {}
    stood: dict[object, str] = {}
    for player in (o for o in world.placed if o.type in domain.player_types):
        target = player.facing or player.tile
        if target not in blocked:
            message = f"faces {target}, where there is no station; players start at a station"
            yield fault(player.name, message)
        if player.facing is not None and player.tile in blocked:
            yield fault(player.name, f"stands inside {blocked[player.tile]} at {player.tile}")
        if target in faced:
            yield fault(player.name, f"faces the same station as {faced[target]}")
        elif player.tile in stood and player.facing is not None:
            yield fault(player.name, f"stands on the same tile as {stood[player.tile]}")
        faced[target] = stood[player.tile] = player.name
    yield from _loose(world, {*blocked, *stood})


def _loose(world: World, hosts: set[object]) -> Iterator[Fault]:
    """Report objects on the bare floor, and two objects in one place."""
    domain = world.task.domain
    fault = _FaultOf(world)
    places: dict[tuple[object, str, int], Object] = {}
    for thing in world.placed:
        if thing.type in (*domain.station_types, *domain.player_types):
            continue
        if thing.tile not in hosts:
            yield fault(thing.name, f"lies on the floor at {thing.tile}: no station is there")
        place = (thing.tile, thing.type, thing.level)
        if place in places:
            other = places[place].name
            yield fault(thing.name, f"is on the same tile {thing.tile} and level as {other}")
        places[place] = thing


def _stations(world: World) -> Iterator[Fault]:
    floor, fault = world.floor, _FaultOf(world)
    for name in floor.stations:
        if floor.reachable and not floor.beside(name):
            tile = floor.stations[name]
            yield fault(name, f"cannot be reached: no walkable tile is next to {tile}")


def _invisible(world: World, known: Set[str]) -> Iterator[Fault]:
    """Report objects that no fact puts on a tile or on a visible object.

    `known` are the places of objects that are reported already.
    """
    report = _FaultOf(world)
    placed = scene(world.initial)
    shown = {name for thing in placed.values() for name in thing.contents}
    for name, thing in placed.items():
        if thing.tile is None and name not in shown and report.place(name) not in known:
            message = (
                "cannot be seen: no fact puts it on a station, on a player or into something; "
                "give the domain a layout rule 'shares_tile' about its type"
            )
            yield report(name, message, "warning")


def _goal(world: World) -> Iterator[Fault]:
    goal = world.goal
    too_few = False
    wanted = Counter(v.kind for v in goal.variables.values())
    world.make_room(wanted)
    for variable in goal.variables.values():
        if not goal.candidates(variable.id):
            too_few = True
            yield Fault("goal", f"there is no {variable.kind}, and none can be made")
    for kind, count in wanted.items():
        variable = next(v for v in goal.variables.values() if v.kind == kind)
        available = len(goal.candidates(variable.id))
        creatable = any(o.kind == kind and o.tile is None for o in world.all_objects())
        if 0 < available < count and not creatable and not variable.fixed:
            too_few = True
            yield Fault("goal", f"needs {count} {kind}, but the problem has {available}")
    if too_few:
        return
    facts = reachable_facts(world)
    if facts is None:
        words = "too many objects to check whether the goal can be reached: more than "
        yield Fault("goal", f"{words}{MAX_CHECKED:,} possible actions", "warning")
        return
    for i, term in enumerate(goal.terms):
        if term.predicate in world.table.static_predicates:
            continue
        if not facts & goal.possible_mask(term):
            said = f"{term.predicate}({', '.join(term.args)})"
            yield Fault(f"goal[{i}]", f"{said} can never become true in this problem")
    try:
        if next(goal.assignments(facts), None) is None:
            yield Fault("goal", "no choice of objects can meet all its predicates")
    except RobotouilleError as error:
        yield Fault("goal", str(error))


MAX_CHECKED = 100_000
"""Most actions, repetitions included, that `reachable_facts` looks at: about 5 s."""


def reachable_facts(world: World) -> int | None:
    """Return the mask of facts that can ever become true, in the delete relaxation.

    Return None if there are too many actions to find out.
    """
    facts = world.initial.facts
    # Facts that can be false: those false at first, and those that some action removes.
    absent = ~facts
    instances = (
        (schema, arguments) for schema in world.schemas for arguments in _all(world, schema)
    )
    pending, checked = list(islice(instances, MAX_CHECKED + 1)), 0
    # A fixed point: each round applies what the facts of the round before allow.
    while True:
        checked += len(pending)
        if checked > MAX_CHECKED:
            return None
        before = (facts, absent)
        waiting = []
        for schema, arguments in pending:
            action = world.action(schema.name, *arguments)
            forbidden = action.tested & ~action.required
            if action.required & ~facts or forbidden & ~absent or action.required & ~action.tested:
                waiting.append((schema, arguments))
                continue
            facts |= action.touched & ~action.removed
            absent |= action.removed
            binding = schema.bind(arguments)
            for effect in schema.effects:
                sets, clears = _effect_results(world, effect.definition, binding)
                facts |= sets
                absent |= clears
        pending = waiting
        if (facts, absent) == before:
            return facts & ~world.table.internal


def _all(world: World, schema: ActionSchema) -> Iterator[tuple[str, ...]]:
    """Yield the argument tuples that static conditions allow."""
    table = world.table
    pools = []
    static = [c for c in schema.definition.precons if c.predicate in table.static_predicates]
    for name, kind in schema.parameters:
        own = [c for c in static if c.params == (name,)]
        pools.append(
            [
                thing
                for thing in table.by_type[kind]
                if all(((c.predicate, thing) in table.static) == c.is_true for c in own)
            ]
        )
    yield from product(*pools)


def _effect_results(world: World, effect: EffectDef, binding: dict[str, str]) -> tuple[int, int]:
    """Return the masks of all facts that an effect may ever make true, and false."""
    table = world.table
    if isinstance(effect, Creation) and effect.created_obj.param not in binding:
        return _creation_results(world, effect, binding)
    sets = table.mask(bound(c, binding) for c in effect.fx if c.is_true)
    clears = table.mask(bound(c, binding) for c in effect.fx if not c.is_true)
    # A conditional effect also undoes its facts when its condition stops holding.
    if effect.type == "conditional":
        sets, clears = sets | clears, sets | clears
    for nested in effect.sfx:
        more, less = _effect_results(world, nested, binding)
        sets |= more
        clears |= less
    return sets, clears


def _creation_results(world: World, effect: Creation, binding: dict[str, str]) -> tuple[int, int]:
    """Return the results of creating any of the spare objects."""
    made = effect.created_obj
    sets = clears = 0
    for thing in world.all_objects():
        if thing.kind == made.name and thing.tile is None:
            bound_to = {**binding, made.param: thing.name}
            more, less = _effect_results(world, effect, bound_to)
            sets |= more | world.table.mask([(EXISTS, thing.name), (USED, thing.name)])
            clears |= less
    return sets, clears


def sound_task(task: Task) -> Task:
    """Return the task if lint finds no errors in its file.

    Shipped tasks and tasks that were not read from a file are not checked.

    Raises:
        FileError: Lint found errors; the exception has all of them.
    """
    if task.folder is None or task.folder.resolve().is_relative_to(data_folder("problems")):
        return task
    errors = [fault for fault in lint_task(task) if fault.severity == "error"]
    if errors:
        raise FileError(task.source, as_in_file(errors, read_json(Path(task.source))))
    return task
