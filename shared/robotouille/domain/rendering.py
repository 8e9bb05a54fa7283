"""Schema of rendering files, which say what picture shows each kind of object in each state.

Two dialects are read: the published one (`version` 1.x) and this project's (2.x). The project's
adds `assets`, `extends`, `floor.tiles`, `floor.wall`, `progress`, `icons`, `language`, several
looks for players with `carrying` and `feet`, and the constants `SCALE`, `STATION_OFFSET` and
`STACK_OFFSET` (the height of an item). See docs/file_formats.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from robotouille.domain.art import (
    Art,
    Facings,
    FileName,
    ParticleEffect,
    Ratio,
    Tool,
    as_listed,
    as_named,
    as_pictured,
)
from robotouille.domain.json_files import read_model
from robotouille.domain.related_files import (
    FileKind,
    chain_of,
    companion_folder,
    each,
    read_extending,
    rendering_path,
    shipped_rendering,
)
from robotouille.domain.schema import Extends, Name, Schema
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, did_you_mean


class Constants(Schema):
    """Sizes in tiles. Fields that are None are taken from the group, then from the defaults."""

    scale: Ratio | None = Field(default=None, alias="SCALE")
    station_offset: Ratio | None = Field(default=None, alias="STATION_OFFSET")
    stack_offset: Ratio | None = Field(default=None, alias="STACK_OFFSET")
    station_item_offset: Ratio | None = Field(default=None, alias="STATION_ITEM_OFFSET")
    station_container_offset: Ratio | None = Field(default=None, alias="STATION_CONTAINER_OFFSET")
    x_scale_factor: Ratio | None = Field(default=None, alias="X_SCALE_FACTOR")
    y_scale_factor: Ratio | None = Field(default=None, alias="Y_SCALE_FACTOR")
    underneath: Annotated[str, Field(max_length=8)] | None = None


class Entity(Schema):
    """Pictures and sizes of one kind."""

    assets: Annotated[Art, BeforeValidator(as_pictured)]
    constants: Constants = Constants()


class EntityGroup(Schema):
    """All kinds of a role, and the sizes they share."""

    constants: Constants = Constants()
    entities: dict[str, Entity] = Field(default={}, max_length=500)


class FloorArt(Schema):
    """Pictures of the room: floor tiles by their letter in a problem's `ground`, and the wall.

    Attributes:
        on_wall: Pictures that hang on the wall, from left to right.
        beside: Pictures for the room to the left and right of the kitchen.
    """

    default: FileName | None = None
    tiles: dict[Annotated[str, Field(min_length=1, max_length=1)], FileName] = Field(default={})
    wall: FileName | None = None
    on_wall: Annotated[tuple[FileName, ...], Field(max_length=16)] = ()
    beside: Annotated[tuple[FileName, ...], Field(max_length=16)] = ()
    ground: tuple[str, ...] = ()
    furniture: tuple[str, ...] = ()


Words = Annotated[str, Field(max_length=200)]


def _done(raw: Any) -> Any:
    return {"do": raw} if isinstance(raw, str) else raw


class KindName(Schema):
    """Name of a kind; of several names the first that applies is used.

    With `when`, the name is for objects for which this predicate holds, as any argument.
    """

    name: Words
    when: Name | None = None


class DishName(Schema):
    """Name of a stack from one kind at the bottom to one at the top, with something in between.

    `begun` names a stack that does not end with `top` yet.
    """

    name: Words
    bottom: Name
    top: Name
    begun: Words = ""


class ActionWords(Schema):
    """Words for an action, and advice (`how`) for when several of its conditions are unmet.

    All templates may name the action's parameters in braces.

    Attributes:
        alike: Words for an action with two objects of one kind, such as one cheese on another.
    """

    do: Words
    how: Words = ""
    alike: Words = ""


class PredicateWords(Schema):
    """Reasons why an action fails: `needed` if the predicate must hold, `forbidden` if it must not.

    `{0}` is the predicate's first argument.
    """

    needed: Words = ""
    forbidden: Words = ""


class PlaceWords(Schema):
    """Words that tell stations of one name apart.

    A station is named by what lies on it, or else by the side of the kitchen and by its order in
    the row there, in reading order.
    """

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
        """Return a place in a row, counted from 0, in words if there are any."""
        return self.ordinals[index] if index < len(self.ordinals) else f"{index + 1}."


class WorkWords(Schema):
    """Words for work that comes first, for waiting, and for what an empty place is for."""

    first: Words = "{action} first"
    first_at: Words = "{action} first, at {place}"
    under_way: Words = "wait until it is done"
    here: Words = "here you can {actions}"
    either: Words = " or "


class SignalWords(Schema):
    """Sentences of the signals. `{thing}` is what a signal points at."""

    need: Words = "I need {thing}, please"
    yours: Words = "you take {thing}, please"
    look: Words = "look at {thing}"
    wait: Words = "wait, please"
    thanks: Words = "thank you"


class Language(Schema):
    """Names that people use for the objects, actions and facts of a domain. All are optional.

    The sentences in domain files are for language models and count for a task's digest. These words
    do not.

    Attributes:
        states: Words before the name of an object for which a predicate holds, by predicate.
        purposes: Words for the purpose of a station, by kind.
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
    states: dict[str, Words] = Field(default={}, max_length=200)
    purposes: dict[str, Words] = Field(default={}, max_length=200)
    dishes: tuple[DishName, ...] = Field(default=(), max_length=100)
    places: PlaceWords = PlaceWords()
    work: WorkWords = WorkWords()
    signals: SignalWords = SignalWords()
    other: Words = "the other {noun}"

    def with_words(self, own: Language) -> Language:
        """Return this language with the words of another laid over it, word by word."""
        work = self.work.model_copy(update=own.work.model_dump(exclude_unset=True))
        places = self.places.model_copy(update=own.places.model_dump(exclude_unset=True))
        signals = self.signals.model_copy(update=own.signals.model_dump(exclude_unset=True))
        return Language(
            kinds={**self.kinds, **own.kinds},
            actions={**self.actions, **own.actions},
            predicates={**self.predicates, **own.predicates},
            states={**self.states, **own.states},
            purposes={**self.purposes, **own.purposes},
            dishes=own.dishes or self.dishes,
            places=places,
            work=work,
            signals=signals,
            other=own.other if "other" in own.model_fields_set else self.other,
        )


NO_WORDS = Language()
"""Language that changes nothing when it is laid over another."""


MAX_FOLDERS = 50
"""Folders and renderings that a rendering may name. Each one is searched on disk."""


class RenderingFile(Schema):
    """Look of a domain, and the words for what is in it.

    Attributes:
        assets: Folder of the pictures.
        inherited_assets: Folders searched next: those of the renderings it extends.
        redraws: Shipped renderings that it does not extend and for which its folder has pictures.
        during: Particle effect by action, shown while that action goes on with an object.
        moments: Particle effect of the players when the game is won or lost.
        tools: Tool by action, moved over an object while that action goes on with it.
    """

    schema_uri: str | None = Field(default=None, alias="$schema")
    extends: Extends = None
    version: str = "1.0.0"
    assets: FileName = "kitchen"
    inherited_assets: Annotated[tuple[FileName, ...], Field(max_length=MAX_FOLDERS)] = ()
    redraws: Annotated[tuple[FileName, ...], Field(max_length=MAX_FOLDERS)] = ()
    floor: FloorArt = FloorArt()
    player: dict[
        str, Annotated[tuple[Facings, ...], BeforeValidator(as_listed), Field(min_length=1)]
    ] = Field(default={})
    item: EntityGroup = EntityGroup()
    station: EntityGroup = EntityGroup()
    container: EntityGroup = EntityGroup()
    progress: dict[str, FileName] = Field(default={})
    icons: dict[str, FileName] = Field(default={})
    language: Language = Language()
    effects: dict[str, ParticleEffect] = Field(default={}, max_length=50)
    during: dict[str, str] = Field(default={})
    moments: dict[Literal["goal", "lost"], str] = Field(default={})
    tools: dict[str, Tool] = Field(default={}, max_length=50)

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
        """Yield each kind with its pictures and their place in the file."""
        for role, group in self._groups().items():
            for kind, entity in group.entities.items():
                for place, art in entity.assets.parts(f"{role}.entities.{kind}.assets"):
                    yield kind, place, art

    def group_of(self, kind: str) -> EntityGroup | None:
        """Return the group that has pictures of a kind."""
        return next((g for g in self._groups().values() if kind in g.entities), None)

    def shows(self, kind: str) -> bool:
        """Return whether a kind has pictures, its own or those of a container that holds it."""
        if kind in self.player or self.group_of(kind) is not None:
            return True
        return any(kind in entity.assets.named for entity in self.container.entities.values())

    def traits(self) -> set[str]:
        """Return the predicates on which any picture depends."""
        return {trait.name for _, _, art in self.arts() for trait in art.predicates}

    def files(self) -> set[str]:
        """Return every picture that the file names."""
        return {file for _, file in self.pictures()}

    def pictures(self) -> Iterator[tuple[str, str]]:
        """Yield every picture that the file names, with its place in the file."""
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
        for field in ("on_wall", "beside"):
            for i, file in enumerate(getattr(self.floor, field)):
                yield f"floor.{field}[{i}]", file
        for name, tool in self.tools.items():
            yield f"tools.{name}", tool.asset
        for role, group in self._groups().items():
            for kind, entity in group.entities.items():
                yield from entity.assets.pictures(f"{role}.entities.{kind}.assets")
        for kind, looks in self.player.items():
            for i, facings in enumerate(looks):
                for place, file in facings.pictures():
                    yield f"player.{kind}[{i}].{place}", file

    def folders(self, beside: Path | None) -> tuple[Path, ...]:
        """Return the folders to search for pictures, in order."""
        names = dict.fromkeys((self.assets, *self.inherited_assets))
        return tuple(companion_folder("assets", name, beside) for name in names)

    def _groups(self) -> dict[str, EntityGroup]:
        return {"item": self.item, "station": self.station, "container": self.container}


_fields = each(
    floor=each(tiles=each()),
    player=each(),
    progress=each(),
    icons=each(),
    language=each(kinds=each(), actions=each(), predicates=each(), places=each(), purposes=each()),
    effects=each(),
    during=each(),
    moments=each(),
    tools=each(),
    **{
        group: each(constants=each(), entities=each()) for group in ("item", "station", "container")
    },
)


def _extend(base: Any, own: Any) -> Any:
    """Merge renderings; one with its own pictures also needs those of the rendering it extends."""
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
    """Return the rendering of a task: its own, the one shipped for its domain, or the kitchen's.

    With the `name` of a shipped rendering, return that one if it extends the task's rendering, or
    the task's rendering with its pictures if it redraws that one. Other domains keep their look.

    Raises:
        FileError: The rendering has faults; the exception lists all of them.
        RobotouilleError: There is no rendering of that name; the message has the nearest one.
    """
    own = rendering_path(task.domain, task.folder)
    if not name:
        return read_extending(own, RENDERING_FILES)
    chosen = shipped_rendering(name)
    if own in chain_of(chosen, RENDERING_FILES):
        return read_extending(chosen, RENDERING_FILES)
    rendering, look = (read_extending(path, RENDERING_FILES) for path in (own, chosen))
    # Only shipped renderings can be redrawn: a redraw names them by their file.
    if own.parent != chosen.parent or own.stem not in look.redraws:
        return rendering
    folders = (rendering.assets, *rendering.inherited_assets)
    return rendering.model_copy(update={"assets": look.assets, "inherited_assets": folders})


def language_of(task: Task) -> Language:
    """Return the words of a task's own rendering; none if it borrows the kitchen's look."""
    domain, path = task.domain, rendering_path(task.domain, task.folder)
    own = (Path(domain.rendering_json or "").name, f"{domain.name}.json")
    is_own = path.name in (*own, f"{domain.name}.rendering.json")
    return rendering_of(task).language if is_own else Language()


def read_language(path: Path) -> Language:
    """Read words that are laid over those of renderings.

    Raises:
        FileError: The file has faults, or it is not a regular file; reading a pipe might never end.
    """
    if path.exists() and not path.is_file():
        raise FileError(str(path), [Fault("", "is not a regular file")])
    return read_model(path, Language)
