"""Schema of rendering files: which picture shows each kind of object in each state.

Two dialects are read: the published one (`version` 1.x) and this project's (2.x), which adds
`assets`, `floor.tiles`, `floor.wall`, `progress`, `icons`, lists of looks for players, and the
constants `SCALE`, `STATION_OFFSET` and `STACK_OFFSET` (the height of the item itself). Nothing
here draws; it only decides which file shows what. See docs/formats.md.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from robotouille.domain.files import read_model
from robotouille.domain.schema import Schema
from robotouille.domain.task import Task
from robotouille.resources import data_folder

__all__ = ["Art", "Constants", "Entity", "Facings", "RenderingFile", "Trait", "rendering_of"]

FileName = Annotated[str, Field(max_length=100, pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")]
Ratio = Annotated[float, Field(ge=-4, le=4, allow_inf_nan=False)]
Fact = tuple[str, ...]
"""A predicate's name, then the kinds of its arguments."""


class Trait(Schema):
    """A condition on what is drawn; without `params` the fact is about the thing alone.

    An empty parameter stands for any kind.
    """

    name: Annotated[str, Field(min_length=1, max_length=64)]
    params: tuple[Annotated[str, Field(max_length=64)], ...] = ()

    def holds(self, own: Collection[str], related: Collection[Fact]) -> bool:
        if not self.params:
            return self.name in own
        return any(self._matches(fact) for fact in related)

    def _matches(self, fact: Fact) -> bool:
        return (
            fact[0] == self.name
            and len(fact) == len(self.params) + 1
            and all(p in ("", kind) for p, kind in zip(self.params, fact[1:], strict=True))
        )


def _named(raw: Any) -> Any:
    return {"name": raw} if isinstance(raw, str) else raw


def _pictured(raw: Any) -> Any:
    return {"asset": raw} if isinstance(raw, str) else raw


def _listed(raw: Any) -> Any:
    return raw if isinstance(raw, list | tuple) else [raw]


class Art(BaseModel):
    """A picture with the predicates under which it is chosen, or a group of such by name.

    In a file a bare string is a picture without conditions. Among the pictures of a group whose
    predicates hold, the one with the most predicates is shown. `tile` (published dialect) names a
    letter of a tileset instead of a picture.
    """

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Annotated[Art, BeforeValidator(_pictured)]] = Field(init=False)

    asset: FileName | None = None
    predicates: tuple[Annotated[Trait, BeforeValidator(_named)], ...] = ()
    tile: Annotated[str, Field(max_length=8)] | None = None

    @model_validator(mode="after")
    def _picture_or_group(self) -> Art:
        if self.asset is not None and self.named:
            raise ValueError(f"a picture with 'asset' cannot hold others ({', '.join(self.named)})")
        if self.asset is None and self.predicates:
            raise ValueError("'predicates' needs an 'asset' beside it")
        if self.asset is None and not self.named and self.tile is None:
            raise ValueError("needs an 'asset' or at least one named picture")
        return self

    @property
    def named(self) -> dict[str, Art]:
        """The members of a group, as in the file."""
        return self.__pydantic_extra__ or {}

    def choose(self, own: Collection[str], related: Collection[Fact] = ()) -> str | None:
        """The picture for a thing of which `own` predicates and `related` facts hold."""
        best, most = self.asset, -1
        for art in self.named.values():
            count = len(art.predicates)
            if art.asset is None or count <= most:
                continue
            if all(trait.holds(own, related) for trait in art.predicates):
                best, most = art.asset, count
        return best

    def files(self) -> Iterator[str]:
        """Every picture that may be chosen."""
        if self.asset is not None:
            yield self.asset
        for art in self.named.values():
            yield from art.files()


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

    assets: Annotated[Art, BeforeValidator(_pictured)]
    constants: Constants = Constants()


class Group(Schema):
    """All kinds of a role, and the sizes they share."""

    constants: Constants = Constants()
    entities: dict[str, Entity] = Field(default={}, max_length=500)


class Facings(Schema):
    """A player's pictures by where it looks; `front` is towards the viewer."""

    front: FileName
    back: FileName
    left: FileName
    right: FileName

    def files(self) -> Iterator[str]:
        yield from (self.front, self.back, self.left, self.right)


class FloorArt(Schema):
    """Pictures of floor tiles by their letter in a problem's `ground`, and of the wall."""

    default: FileName | None = None
    tiles: dict[Annotated[str, Field(min_length=1, max_length=1)], FileName] = Field(default={})
    wall: FileName | None = None
    ground: tuple[str, ...] = ()
    furniture: tuple[str, ...] = ()


class RenderingFile(Schema):
    """How a domain looks. `assets` is the folder of its pictures among the shipped assets."""

    schema_uri: str | None = Field(default=None, alias="$schema")
    version: str = "1.0.0"
    assets: FileName = "kitchen"
    floor: FloorArt = FloorArt()
    player: dict[
        str, Annotated[tuple[Facings, ...], BeforeValidator(_listed), Field(min_length=1)]
    ] = Field(default={})
    item: Group = Group()
    station: Group = Group()
    container: Group = Group()
    progress: dict[str, FileName] = Field(default={})
    icons: dict[str, FileName] = Field(default={})

    def group_of(self, kind: str) -> Group | None:
        """The group that has pictures of a kind."""
        return next((g for g in self._groups() if kind in g.entities), None)

    def files(self) -> set[str]:
        """Every picture the file names."""
        found = {*self.progress.values(), *self.icons.values(), *self.floor.tiles.values()}
        found.update(f for f in (self.floor.default, self.floor.wall) if f is not None)
        for group in self._groups():
            for entity in group.entities.values():
                found.update(entity.assets.files())
        for looks in self.player.values():
            for facings in looks:
                found.update(facings.files())
        return found

    def _groups(self) -> tuple[Group, Group, Group]:
        return self.item, self.station, self.container


def rendering_of(task: Task) -> RenderingFile:
    """The rendering beside a task or shipped for its domain; the kitchen's where there is none."""
    path = task.companion("renderings", task.domain.rendering_json or f"{task.domain.name}.json")
    if not path.is_file():
        path = data_folder("renderings") / "robotouille.json"
    return read_model(path, RenderingFile)
