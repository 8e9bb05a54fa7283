"""Schema of rendering files: which picture shows each kind of object in each state.

Two dialects are read: the published one (`version` 1.x) and this project's (2.x), which adds
`assets`, `extends`, `floor.tiles`, `floor.wall`, `progress`, `icons`, `language`, lists of looks
for players with their `carrying` and `feet`, and the constants `SCALE`, `STATION_OFFSET` and
`STACK_OFFSET` (the height of the item itself). Nothing here draws; it only decides which file shows
what. See docs/formats.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from robotouille.domain.companions import companion_folder, rendering_path, shipped_rendering
from robotouille.domain.extends import FileKind, chain_of, each, read_extending
from robotouille.domain.files import read_model
from robotouille.domain.rendering.art import (
    Art,
    Effect,
    Facings,
    FileName,
    Ratio,
    as_listed,
    as_named,
    as_pictured,
)
from robotouille.domain.schema import Extends, Name, Schema
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, did_you_mean

__all__ = [
    "RENDERING_FILES",
    "ActionWords",
    "Constants",
    "Entity",
    "KindName",
    "Language",
    "PredicateWords",
    "RenderingFile",
    "language_of",
    "rendering_of",
]


class Constants(Schema):
    """Sizes in tiles; what is None is taken from the group, then from `Constants.default`."""

    scale: Ratio | None = Field(default=None, alias="SCALE")
    station_offset: Ratio | None = Field(default=None, alias="STATION_OFFSET")
    stack_offset: Ratio | None = Field(default=None, alias="STACK_OFFSET")
    station_item_offset: Ratio | None = Field(default=None, alias="STATION_ITEM_OFFSET")
    station_container_offset: Ratio | None = Field(default=None, alias="STATION_CONTAINER_OFFSET")
    x_scale_factor: Ratio | None = Field(default=None, alias="X_SCALE_FACTOR")
    y_scale_factor: Ratio | None = Field(default=None, alias="Y_SCALE_FACTOR")
    underneath: Annotated[str, Field(max_length=8)] | None = None


class Entity(Schema):
    """The pictures and sizes of one kind."""

    assets: Annotated[Art, BeforeValidator(as_pictured)]
    constants: Constants = Constants()


class Group(Schema):
    """All kinds of a role, and the sizes they share."""

    constants: Constants = Constants()
    entities: dict[str, Entity] = Field(default={}, max_length=500)


class FloorArt(Schema):
    """Pictures of floor tiles by their letter in a problem's `ground`, and of the wall."""

    default: FileName | None = None
    tiles: dict[Annotated[str, Field(min_length=1, max_length=1)], FileName] = Field(default={})
    wall: FileName | None = None
    ground: tuple[str, ...] = ()
    furniture: tuple[str, ...] = ()


Words = Annotated[str, Field(max_length=200)]


def _done(raw: Any) -> Any:
    return {"do": raw} if isinstance(raw, str) else raw


class KindName(Schema):
    """What a thing of a kind is called: the first name that applies. With `when` it is for things
    of which this predicate holds, as any of its arguments."""

    name: Words
    when: Name | None = None


class ActionWords(Schema):
    """What an action does to things, and how one gets there where more than one thing is missing.

    Both may name the action's parameters in braces.
    """

    do: Words
    how: Words = ""


class PredicateWords(Schema):
    """What to tell somebody whose action fails by a predicate: `needed`, where it has to hold and
    does not; `forbidden`, where it holds and must not. `{0}` is its first argument."""

    needed: Words = ""
    forbidden: Words = ""


class PlaceWords(Schema):
    """How stations that are called the same are told apart: by what lies there, else by the side
    of the kitchen where they are, and by their order in the row there: as one reads."""

    with_things: Words = "the {noun} with {things}"
    single: Words = "the {noun} {side}"
    one_of_few: Words = "the {order} {noun} {side}"
    one_of_many: Words = "the {number} {noun} {side}"
    top: Words = "at the top"
    bottom: Words = "at the bottom"
    left: Words = "on the left"
    right: Words = "on the right"
    middle: Words = "in the middle"
    across: tuple[Words, Words, Words] = ("left", "middle", "right")
    downwards: tuple[Words, Words, Words] = ("top", "middle", "bottom")
    ordinals: tuple[Words, ...] = (
        "first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth",
    )  # fmt: skip

    def number(self, index: int) -> str:
        """The place in a row, counted from 0, in words as far as there are any."""
        return self.ordinals[index] if index < len(self.ordinals) else f"{index + 1}."


class WorkWords(Schema):
    """What to do first (`first`; `first_at`, where it is known at which place), what is to be
    waited for, and what a place is for where nothing is."""

    first: Words = "{action} first"
    first_at: Words = "{action} first, at {place}"
    under_way: Words = "wait until it is done"
    here: Words = "here you can {actions}"
    either: Words = " or "


class Language(Schema):
    """What a person calls the things, actions and facts of a domain. All of it is optional.

    Domain files have sentences of their own, which name actions and tell language models what is
    so: they are part of a task's hash, and these words are not.
    """

    kinds: dict[
        str,
        Annotated[
            tuple[Annotated[KindName, BeforeValidator(as_named)], ...], BeforeValidator(as_listed)
        ],
    ] = Field(default={}, max_length=500)
    actions: dict[str, Annotated[ActionWords, BeforeValidator(_done)]] = Field(
        default={}, max_length=200
    )
    predicates: dict[str, PredicateWords] = Field(default={}, max_length=500)
    places: PlaceWords = PlaceWords()
    work: WorkWords = WorkWords()
    other: Words = "the other {noun}"

    def with_words(self, own: Language) -> Language:
        """The same with other words laid over it: kind by kind, action by action, predicate by
        predicate, and each of those for places and for work."""
        work = self.work.model_copy(update=own.work.model_dump(exclude_unset=True))
        places = self.places.model_copy(update=own.places.model_dump(exclude_unset=True))
        return Language(
            kinds={**self.kinds, **own.kinds},
            actions={**self.actions, **own.actions},
            predicates={**self.predicates, **own.predicates},
            places=places,
            work=work,
            other=own.other if "other" in own.model_fields_set else self.other,
        )


NO_WORDS = Language()
"""Laid over a language, it leaves it as it is."""


class RenderingFile(Schema):
    """How a domain looks, and (`language`) what people call what is in it.

    `assets` is the folder of its pictures; what is not there is looked for in those of
    `inherited_assets`, which are the folders of the renderings it extends. `redraws` are shipped
    renderings that it does not extend, and of whose pictures its folder has some. `during` names
    the effect that leaves a thing while an action is in progress with it, `moments` that of players
    when something happens.
    """

    schema_uri: str | None = Field(default=None, alias="$schema")
    extends: Extends = None
    version: str = "1.0.0"
    assets: FileName = "kitchen"
    inherited_assets: tuple[FileName, ...] = ()
    redraws: tuple[FileName, ...] = ()
    floor: FloorArt = FloorArt()
    player: dict[
        str, Annotated[tuple[Facings, ...], BeforeValidator(as_listed), Field(min_length=1)]
    ] = Field(default={})
    item: Group = Group()
    station: Group = Group()
    container: Group = Group()
    progress: dict[str, FileName] = Field(default={})
    icons: dict[str, FileName] = Field(default={})
    language: Language = Language()
    effects: dict[str, Effect] = Field(default={}, max_length=50)
    during: dict[str, str] = Field(default={})
    moments: dict[Literal["goal", "lost"], str] = Field(default={})

    @model_validator(mode="after")
    def _known_effects(self) -> RenderingFile:
        for place, name in self._named_effects():
            if name not in self.effects:
                near = did_you_mean(name, self.effects)
                raise ValueError(f"{place}: there is no effect {name!r}{near}")
        return self

    def _named_effects(self) -> Iterator[tuple[str, str]]:
        for field in ("during", "moments"):
            for key, name in getattr(self, field).items():
                yield f"{field}.{key}", name
        for _, place, art in self.arts():
            for name in art.effects:
                yield f"{place}.effects", name

    def arts(self) -> Iterator[tuple[str, str, Art]]:
        """Each kind with its pictures, and their place in the file."""
        for role, group in self._groups().items():
            for kind, entity in group.entities.items():
                for place, art in entity.assets.parts(f"{role}.entities.{kind}.assets"):
                    yield kind, place, art

    def group_of(self, kind: str) -> Group | None:
        """The group that has pictures of a kind."""
        return next((g for g in self._groups().values() if kind in g.entities), None)

    def shows(self, kind: str) -> bool:
        """Whether there are pictures of a kind, be it by those of a container that holds it."""
        if kind in self.player or self.group_of(kind) is not None:
            return True
        return any(kind in entity.assets.named for entity in self.container.entities.values())

    def traits(self) -> set[str]:
        """The predicates on which any picture depends."""
        return {trait.name for _, _, art in self.arts() for trait in art.predicates}

    def files(self) -> set[str]:
        """Every picture the file names."""
        return {file for _, file in self.pictures()}

    def pictures(self) -> Iterator[tuple[str, str]]:
        """Every picture the file names, with its place in the file."""
        for field in ("progress", "icons"):
            for name, file in getattr(self, field).items():
                yield f"{field}.{name}", file
        for name, effect in self.effects.items():
            yield f"effects.{name}", effect.asset
        for letter, file in self.floor.tiles.items():
            yield f"floor.tiles.{letter}", file
        for field in ("default", "wall"):
            if getattr(self.floor, field) is not None:
                yield f"floor.{field}", getattr(self.floor, field)
        for role, group in self._groups().items():
            for kind, entity in group.entities.items():
                yield from entity.assets.pictures(f"{role}.entities.{kind}.assets")
        for kind, looks in self.player.items():
            for i, facings in enumerate(looks):
                for place, file in facings.pictures():
                    yield f"player.{kind}[{i}].{place}", file

    def folders(self, beside: Path | None) -> tuple[Path, ...]:
        """Where its pictures are looked for, the first first."""
        names = dict.fromkeys((self.assets, *self.inherited_assets))
        return tuple(companion_folder("assets", name, beside) for name in names)

    def _groups(self) -> dict[str, Group]:
        return {"item": self.item, "station": self.station, "container": self.container}


_fields = each(
    floor=each(tiles=each()),
    player=each(),
    progress=each(),
    icons=each(),
    language=each(kinds=each(), actions=each(), predicates=each(), places=each()),
    effects=each(),
    during=each(),
    moments=each(),
    **{
        group: each(constants=each(), entities=each()) for group in ("item", "station", "container")
    },
)


def _extend(base: Any, own: Any) -> Any:
    """A rendering with pictures of its own needs those of the extended one as well."""
    merged = _fields(base, own)
    if isinstance(merged, dict) and "assets" in own and "inherited_assets" not in own:
        inherited = [base.get("assets", "kitchen"), *base.get("inherited_assets", ())]
        merged["inherited_assets"] = inherited
    return merged


RENDERING_FILES = FileKind(
    RenderingFile,
    folder="renderings",
    shipped=".json",
    beside=".rendering.json",
    merge=_extend,
)


def rendering_of(task: Task, name: str = "") -> RenderingFile:
    """The rendering beside a task or shipped for its domain; the kitchen's where there is none.

    With the `name` of a shipped one, that one in its place, if it extends it, or with its pictures,
    if it redraws it: other domains look as they do. FileError lists all faults, RobotouilleError
    has the nearest name.
    """
    own = rendering_path(task.domain, task.folder)
    if not name:
        return read_extending(own, RENDERING_FILES)
    chosen = shipped_rendering(name)
    if own in chain_of(chosen, RENDERING_FILES):
        return read_extending(chosen, RENDERING_FILES)
    rendering, look = (read_extending(path, RENDERING_FILES) for path in (own, chosen))
    if own.parent != chosen.parent or own.stem not in look.redraws:
        return rendering
    folders = (rendering.assets, *rendering.inherited_assets)
    return rendering.model_copy(update={"assets": look.assets, "inherited_assets": folders})


def language_of(task: Task) -> Language:
    """What people call the things of a task, by its own rendering; nothing where it has none, and
    looks like the kitchen."""
    domain, path = task.domain, rendering_path(task.domain, task.folder)
    own = (Path(domain.rendering_json or "").name, f"{domain.name}.json")
    is_own = path.name in (*own, f"{domain.name}.rendering.json")
    return rendering_of(task).language if is_own else Language()


def read_language(path: Path) -> Language:
    """Words in a file of their own, to be laid over those of renderings; FileError lists all its
    faults, or says that it is no file: a pipe would never end."""
    if path.exists() and not path.is_file():
        raise FileError(str(path), [Fault("", "is no file")])
    return read_model(path, Language)
