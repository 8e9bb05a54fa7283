"""Special effects and their updates (docs/episodes.md, "Special effects"; paper, section 2).

An `Effect` is a special effect bound to objects. Its progress is a tuple of integers, one for each
node of its tree in depth-first order. `EffectRun` performs the updates of one step in the most
direct way; `timers.py` caches their results.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robotouille.domain.schema import Condition, CreatedObject, Creation, EffectDef, InstantEffect
from robotouille.world.grounding.atoms import EXISTS, USED, AtomTable
from robotouille.world.grounding.objects import bound

PAUSED, HOLDING, DONE = 0, 1, -1


@dataclass(frozen=True, slots=True)
class EffectNode:
    """Node of an effect's tree, with its conditions and results as bit masks.

    Its kind sets `counts`, `instant`, `reverts` and `pauses` (see `domain.schema.SpecialEffect`).
    `total` is the number of updates after which a counting node takes effect.
    """

    kind: str
    counts: str
    instant: bool
    reverts: bool
    pauses: bool
    slot: int
    subject: str
    total: int
    tested: int
    required: int
    possible: bool
    sets: int
    clears: int
    nested: tuple[EffectNode, ...]
    created: CreatedObject | None = None
    fx: tuple[Condition, ...] = ()
    sfx: tuple[EffectDef, ...] = ()
    binding: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Effect:
    """Special effect bound to objects; equal effects are the same object.

    `label` is `(action, index of the effect in the action, arguments)`. `reads` masks the atoms
    that an update tests.
    """

    label: tuple[str, int, tuple[str, ...]]
    root: EffectNode
    size: int
    reads: int
    subject: str

    def __str__(self) -> str:
        action, index, arguments = self.label
        return f"{action}.{index}({', '.join(arguments)})"

    @property
    def start(self) -> tuple[int, ...]:
        """Progress before the first update."""
        return (0,) * self.size

    def counters(self) -> list[EffectNode]:
        """Return the nodes that count steps or performances, outermost first."""
        return [node for node in _walk(self.root) if node.counts]


def _walk(node: EffectNode) -> list[EffectNode]:
    return [node, *(inner for child in node.nested for inner in _walk(child))]


def compile_effect(
    definition: EffectDef,
    label: tuple[str, int, tuple[str, ...]],
    binding: dict[str, str],
    table: AtomTable,
    count: Callable[[EffectDef, str], int],
) -> Effect:
    """Bind an effect's parameters to objects; `count` returns the updates of a counting node."""
    slots = iter(range(10_000))
    root = _compile_node(definition, binding, table, count, slots.__next__)
    nodes = _walk(root)
    reads = 0
    for node in nodes:
        reads |= node.tested
    return Effect(label, root, len(nodes), reads, root.subject)


def _compile_node(
    definition: EffectDef,
    binding: dict[str, str],
    table: AtomTable,
    count: Callable[[EffectDef, str], int],
    next_slot: Callable[[], int],
) -> EffectNode:
    slot = next_slot()
    tested, required, possible = table.test(
        (bound(c, binding), c.is_true) for c in getattr(definition, "conditions", ())
    )
    creation = definition if isinstance(definition, Creation) else None
    instant = isinstance(definition, InstantEffect)
    sets = clears = 0
    # A creation's results mention an object that has no name before the creation happens.
    if creation is None:
        sets = table.mask(bound(c, binding) for c in definition.fx if c.is_true)
        clears = table.mask(bound(c, binding) for c in definition.fx if not c.is_true)
    subject = binding.get(definition.param, definition.param)
    return EffectNode(
        kind=definition.type,
        counts=definition.counts,
        instant=definition.instant,
        reverts=definition.reverts,
        pauses=definition.pauses,
        slot=slot,
        subject=subject,
        total=count(definition, subject) if definition.counts else 0,
        tested=tested,
        required=required,
        possible=possible,
        sets=sets,
        clears=clears & ~sets,
        nested=()
        if instant
        else tuple(
            _compile_node(nested, binding, table, count, next_slot) for nested in definition.sfx
        ),
        created=creation.created_obj if creation else None,
        fx=creation.fx if creation else (),
        sfx=definition.sfx if instant else (),
        binding=tuple(binding.items()) if instant else (),
    )


class EffectRun:
    """Updates of effects within one step: reads and changes `facts`, and records what it wrote.

    `create(kind, type, facts)` returns the name of a new object. `born` compiles an effect nested
    in a creation or deletion: since those complete at once, nested effects start as effects of
    their own. No fact about a deleted object becomes true again.
    """

    def __init__(
        self,
        facts: int,
        table: AtomTable,
        create: Callable[[str, str, int], str],
        born: Callable[[EffectDef, dict[str, str]], Effect],
    ) -> None:
        self.facts = facts
        self.written = 0
        self.deleted: list[str] = []
        self.started: list[Effect] = []
        self.table = table
        self.create = create
        self._born = born

    def write(self, sets: int, clears: int) -> None:
        """Make facts true and false; an atom in both masks becomes true."""
        for name in self.deleted:
            sets &= ~self.table.mentions(name)
        self.facts = (self.facts & ~clears) | sets
        self.written |= sets | clears

    def concerns_deleted(self, effect: Effect) -> bool:
        """Return whether a deleted object is among an effect's arguments, which ends the effect."""
        return any(name in effect.label[2] for name in self.deleted)

    def update(self, effect: Effect, progress: tuple[int, ...], active: bool) -> tuple[int, ...]:
        """Update an effect once and return its new progress; the root is `DONE` on completion."""
        counters = list(progress)
        self._update(effect.root, counters, active)
        return tuple(counters)

    def update_nested(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        """Update a node's nested effects and return whether all have completed."""
        # All are updated even if an early one is unfinished: nested effects run in parallel.
        finished = [self._update(child, progress, active) for child in node.nested]
        return all(finished)

    def start_nested(self, node: EffectNode, binding: dict[str, str]) -> None:
        """Start the effects nested in an instant one as effects of their own."""
        born = (self._born(definition, binding) for definition in node.sfx)
        self.started += [effect for effect in born if not self.concerns_deleted(effect)]

    def _update(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        if progress[node.slot] == DONE:
            return True
        finished = UPDATES[node.kind](self, node, progress, active)
        if finished:
            progress[node.slot] = DONE
        return finished


def _update_conditional(
    run: EffectRun, node: EffectNode, progress: list[int], active: bool
) -> bool:
    if node.possible and run.facts & node.tested == node.required:
        progress[node.slot] = HOLDING
        run.write(node.sets, node.clears)
        return run.update_nested(node, progress, active)
    if progress[node.slot] == HOLDING:
        progress[node.slot] = PAUSED
        run.write(node.clears, node.sets)
    return False


def _update_counting(run: EffectRun, node: EffectNode, progress: list[int], active: bool) -> bool:
    if progress[node.slot] < node.total:
        # A delay counts the steps that pass, a repetition the performances of its action.
        if active != (node.counts == "performances"):
            return False
        progress[node.slot] += 1
        if progress[node.slot] < node.total:
            return False
        run.write(node.sets, node.clears)
    return run.update_nested(node, progress, active)


def _update_creation(run: EffectRun, node: EffectNode, progress: list[int], active: bool) -> bool:
    if node.created is None:
        raise AssertionError("a creation effect without an object")
    name = run.create(node.created.name, node.created.type, run.facts)
    binding = {**dict(node.binding), node.created.param: name}
    # USED stays true after a deletion, so that a name is never given to a second object.
    born = run.table.mask(((EXISTS, name), (USED, name)))
    sets = run.table.mask(bound(c, binding) for c in node.fx if c.is_true)
    clears = run.table.mask(bound(c, binding) for c in node.fx if not c.is_true)
    run.write(sets | born, clears & ~sets)
    run.start_nested(node, binding)
    return True


def _update_deletion(run: EffectRun, node: EffectNode, progress: list[int], active: bool) -> bool:
    gone = run.table.mentions(node.subject) & ~run.table.mask([(USED, node.subject)])
    run.write(node.sets, node.clears)
    run.write(0, gone)
    run.deleted.append(node.subject)
    run.start_nested(node, dict(node.binding))
    return True


Update = Callable[[EffectRun, EffectNode, list[int], bool], bool]
UPDATES: dict[str, Update] = {
    "conditional": _update_conditional,
    "delayed": _update_counting,
    "repetitive": _update_counting,
    "creation": _update_creation,
    "deletion": _update_deletion,
}
"""Update of each kind of special effect: changes the run's facts and the node's progress.

It returns whether the node has completed. `active` tells an update caused by performing the action
from one caused by the passing of a step.
"""
