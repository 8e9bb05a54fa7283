"""Special effects: five kinds that nest, and their counters (world.md, "Special effects").

An `Effect` is a special effect with its arguments. Its progress is a tuple with one integer for
each node of its tree, in depth-first order. `EffectRun` performs updates, slowly and plainly;
`timers.py` remembers what they did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robotouille.domain.schema import Condition, CreatedObject, Creation, Deletion, EffectDef
from robotouille.world.grounding.atoms import EXISTS, USED, AtomTable
from robotouille.world.grounding.objects import bound

__all__ = ["DONE", "HOLDING", "Effect", "EffectNode", "EffectRun", "compile_effect"]

PAUSED, HOLDING, DONE = 0, 1, -1


@dataclass(frozen=True, slots=True)
class EffectNode:
    """One node of an effect's tree, its conditions and results as masks.

    `total` is the number of updates after which a delayed or repetitive node takes effect.
    """

    kind: str
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


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """A special effect with its arguments; the same effect and arguments are the same object.

    `label` is `(action, index of the effect in it, its arguments)`; `reads` the atoms on which
    the course of an update depends.
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
        return (0,) * self.size

    def counters(self) -> list[EffectNode]:
        """The nodes that count steps or performances, outermost first."""
        return [node for node in _walk(self.root) if node.kind in ("delayed", "repetitive")]


def _walk(node: EffectNode) -> list[EffectNode]:
    return [node, *(inner for child in node.nested for inner in _walk(child))]


def compile_effect(
    definition: EffectDef,
    label: tuple[str, int, tuple[str, ...]],
    binding: dict[str, str],
    table: AtomTable,
    count: Callable[[EffectDef, str], int],
) -> Effect:
    """Bind an effect's parameters to objects; `count` says how long a node takes."""
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
    instant = isinstance(definition, Creation | Deletion)
    sets = clears = 0
    if creation is None:
        sets = table.mask(bound(c, binding) for c in definition.fx if c.is_true)
        clears = table.mask(bound(c, binding) for c in definition.fx if not c.is_true)
    timed = definition.type in ("delayed", "repetitive")
    subject = binding.get(definition.param, definition.param)
    return EffectNode(
        kind=definition.type,
        slot=slot,
        subject=subject,
        total=count(definition, subject) if timed else 0,
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
    """Updates of effects within one step: facts in, facts out, and what was written.

    `create(kind, type, facts)` names a new object; `born` compiles an effect nested in a creation
    or deletion, which completes at once: what is nested in it starts as an effect of its own. Of
    an object once deleted nothing becomes true any more.
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
        self._table = table
        self._create = create
        self._born = born

    def write(self, sets: int, clears: int) -> None:
        """Make facts true and false; where both are asked for, true wins."""
        for name in self.deleted:
            sets &= ~self._table.mentions(name)
        self.facts = (self.facts & ~clears) | sets
        self.written |= sets | clears

    def concerns_deleted(self, effect: Effect) -> bool:
        """Whether an effect is about an object that has been deleted: then it has ended."""
        return any(name in effect.label[2] for name in self.deleted)

    def update(self, effect: Effect, progress: tuple[int, ...], active: bool) -> tuple[int, ...]:
        """One update of an effect; returns its new progress (root `DONE` when it completed)."""
        counters = list(progress)
        self._update(effect.root, counters, active)
        return tuple(counters)

    def _update(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        if progress[node.slot] == DONE:
            return True
        finished = {
            "conditional": self._conditional,
            "delayed": self._counting,
            "repetitive": self._counting,
            "creation": self._creation,
            "deletion": self._deletion,
        }[node.kind](node, progress, active)
        if finished:
            progress[node.slot] = DONE
        return finished

    def _nested(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        finished = [self._update(child, progress, active) for child in node.nested]
        return all(finished)

    def _conditional(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        if node.possible and self.facts & node.tested == node.required:
            progress[node.slot] = HOLDING
            self.write(node.sets, node.clears)
            return self._nested(node, progress, active)
        if progress[node.slot] == HOLDING:
            progress[node.slot] = PAUSED
            self.write(node.clears, node.sets)
        return False

    def _counting(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        if progress[node.slot] < node.total:
            if active != (node.kind == "repetitive"):
                return False
            progress[node.slot] += 1
            if progress[node.slot] < node.total:
                return False
            self.write(node.sets, node.clears)
        return self._nested(node, progress, active)

    def _creation(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        if node.created is None:
            raise AssertionError("a creation effect without an object")
        name = self._create(node.created.name, node.created.type, self.facts)
        binding = {**dict(node.binding), node.created.param: name}
        born = self._table.mask(((EXISTS, name), (USED, name)))
        sets = self._table.mask(bound(c, binding) for c in node.fx if c.is_true)
        clears = self._table.mask(bound(c, binding) for c in node.fx if not c.is_true)
        self.write(sets | born, clears & ~sets)
        self._start_nested(node, binding)
        return True

    def _start_nested(self, node: EffectNode, binding: dict[str, str]) -> None:
        born = (self._born(definition, binding) for definition in node.sfx)
        self.started += [effect for effect in born if not self.concerns_deleted(effect)]

    def _deletion(self, node: EffectNode, progress: list[int], active: bool) -> bool:
        gone = self._table.mentions(node.subject) & ~self._table.mask([(USED, node.subject)])
        self.write(node.sets, node.clears)
        self.write(0, gone)
        self.deleted.append(node.subject)
        self._start_nested(node, dict(node.binding))
        return True
