"""Parts of rendering files: pictures with conditions, players' pictures and particle effects."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from math import ceil
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from robotouille.domain.schema import Schema

FileName = Annotated[str, Field(max_length=100, pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$")]
Ratio = Annotated[float, Field(ge=-4, le=4, allow_inf_nan=False)]
SIDES = ("front", "back", "left", "right")
Fact = tuple[str, ...]
"""Predicate name, then the kinds of the arguments."""


class Trait(Schema):
    """Condition of a picture. Without `params` the fact is about the object alone.

    An empty parameter stands for any kind.
    """

    name: Annotated[str, Field(min_length=1, max_length=64)]
    params: tuple[Annotated[str, Field(max_length=64)], ...] = ()

    def holds(self, own: Collection[str], related: Collection[Fact]) -> bool:
        """Return whether the condition holds for an object's own predicates and related facts."""
        if not self.params:
            return self.name in own
        return any(self._matches(fact) for fact in related)

    def _matches(self, fact: Fact) -> bool:
        return (
            fact[0] == self.name
            and len(fact) == len(self.params) + 1
            and all(p in ("", kind) for p, kind in zip(self.params, fact[1:], strict=True))
        )


def as_named(raw: Any) -> Any:
    return {"name": raw} if isinstance(raw, str) else raw


def as_pictured(raw: Any) -> Any:
    return {"asset": raw} if isinstance(raw, str) else raw


def as_listed(raw: Any) -> Any:
    return raw if isinstance(raw, list | tuple) else [raw]


class Art(BaseModel):
    """Picture with the conditions under which it is chosen, or a group of pictures by name.

    In a file, a bare string is a picture without conditions. Of a group's pictures whose conditions
    hold, the one with the most conditions is shown.

    Attributes:
        during: Actions in progress with the object. At least one is needed; together they count as
            one condition.
        stages: Pictures that replace `asset`, one after the other, while that action goes on.
        effects: Particle effects of the object while this picture is shown.
        tile: Letter of a tileset in place of a picture (published dialect).
    """

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Annotated[Art, BeforeValidator(as_pictured)]] = Field(init=False)

    asset: FileName | None = None
    predicates: tuple[Annotated[Trait, BeforeValidator(as_named)], ...] = ()
    during: tuple[Annotated[str, Field(max_length=64)], ...] = ()
    stages: Annotated[tuple[FileName, ...], Field(max_length=16)] = ()
    effects: tuple[Annotated[str, Field(max_length=64)], ...] = ()
    tile: Annotated[str, Field(max_length=8)] | None = None

    @model_validator(mode="after")
    def _picture_or_group(self) -> Art:
        if self.asset is not None and self.named:
            raise ValueError(f"a picture with 'asset' cannot hold others ({', '.join(self.named)})")
        for field in ("predicates", "during", "stages", "effects"):
            if self.asset is None and getattr(self, field):
                raise ValueError(f"{field!r} needs an 'asset' next to it")
        if self.stages and not self.during:
            raise ValueError("'stages' need 'during': the actions that they are stages of")
        if self.asset is None and not self.named and self.tile is None:
            raise ValueError("needs an 'asset' or at least one named picture")
        return self

    @property
    def named(self) -> dict[str, Art]:
        """Members of a group, as in the file."""
        return self.__pydantic_extra__ or {}

    def choose(self, own: Collection[str], related: Collection[Fact] = ()) -> str | None:
        """Return the picture for an object with these predicates and facts."""
        return self.chosen(own, related).asset

    def chosen(
        self, own: Collection[str], related: Collection[Fact] = (), doing: Collection[str] = ()
    ) -> Art:
        """Return the chosen picture with all its fields, while the actions `doing` go on."""
        best, most = self, -1
        for art in self.named.values():
            count = len(art.predicates) + bool(art.during)
            if art.asset is None or count <= most:
                continue
            if art.during and not any(action in doing for action in art.during):
                continue
            if all(trait.holds(own, related) for trait in art.predicates):
                best, most = art, count
        return best

    def at(self, doing: Mapping[str, float]) -> str | None:
        """Return the picture to show during actions, given the share of each that is done."""
        if not self.stages:
            return self.asset
        share = max((doing[action] for action in self.during if action in doing), default=0.0)
        return self.stages[max(0, min(ceil(share * len(self.stages)), len(self.stages)) - 1)]

    def parts(self, place: str) -> Iterator[tuple[str, Art]]:
        """Yield this picture and all that it holds, each with its place in the file."""
        yield place, self
        for name, art in self.named.items():
            yield from art.parts(f"{place}.{name}")

    def pictures(self, place: str) -> Iterator[tuple[str, str]]:
        """Yield every picture that may be chosen, with its place in the file."""
        if self.asset is not None:
            yield place, self.asset
        for i, stage in enumerate(self.stages):
            yield f"{place}.stages[{i}]", stage
        for name, art in self.named.items():
            yield from art.pictures(f"{place}.{name}")


class Sides(Schema):
    """Pictures of a player by direction; `front` faces the viewer."""

    front: FileName
    back: FileName
    left: FileName
    right: FileName

    def pictures(self) -> Iterator[tuple[str, str]]:
        """Yield every picture with its place."""
        for side in SIDES:
            yield side, getattr(self, side)


Frames = Annotated[
    tuple[FileName, ...], BeforeValidator(as_listed), Field(min_length=1, max_length=8)
]


class Feet(Schema):
    """Pictures below those of a player: the first one standing, all in turn walking."""

    front: Frames
    back: Frames
    left: Frames
    right: Frames

    def pictures(self) -> Iterator[tuple[str, str]]:
        """Yield every picture with its place."""
        for side in SIDES:
            for i, file in enumerate(getattr(self, side)):
                yield f"{side}[{i}]", file


class ShutEyes(Schema):
    """Pictures of shut eyes, drawn over a player's face. From the back no eyes are visible."""

    front: FileName
    left: FileName
    right: FileName

    def pictures(self) -> Iterator[tuple[str, str]]:
        """Yield every picture with its place."""
        for side in ("front", "left", "right"):
            yield side, getattr(self, side)


class Facings(Sides):
    """A player's pictures.

    Attributes:
        carrying: Pictures for full hands.
        cheering: Picture with raised arms, facing the viewer.
        feet: Pictures drawn below those of the player.
        shut: Pictures drawn over the face when the player blinks.
    """

    carrying: Sides | None = None
    cheering: FileName | None = None
    feet: Feet | None = None
    shut: ShutEyes | None = None

    def pictures(self) -> Iterator[tuple[str, str]]:
        """Yield every picture with its place."""
        yield from super().pictures()
        if self.cheering is not None:
            yield "cheering", self.cheering
        for name in ("carrying", "feet", "shut"):
            part = getattr(self, name)
            for place, file in part.pictures() if part is not None else ():
                yield f"{name}.{place}", file


Size = Annotated[float, Field(gt=0, le=2, allow_inf_nan=False)]


class Tool(Schema):
    """Tool that moves over an object while an action goes on with it.

    Attributes:
        motion: `chop` moves the tool up and down, `scrub` from side to side.
        size: Side of the picture, in tiles.
    """

    asset: FileName
    motion: Literal["chop", "scrub"] = "chop"
    size: Size = 0.5


class ParticleEffect(Schema):
    """Small pictures that leave an object one after the other and fade: steam, sparks, crumbs.

    Attributes:
        count: Particles at a time.
        steps: Steps for which each particle is visible.
        start: Height above the object's middle at which a particle begins, in tiles.
        rise: Tiles upwards; downwards if negative.
        spread: Greatest distance to a side, in tiles.
        size: First and last size, in tiles.
    """

    asset: FileName
    count: Annotated[int, Field(ge=1, le=8)] = 3
    steps: Annotated[float, Field(ge=0.25, le=50)] = 3.0
    start: Ratio = 0.0
    rise: Ratio = 0.4
    spread: Ratio = 0.12
    size: tuple[Size, Size] = (0.1, 0.2)
