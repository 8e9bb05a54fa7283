"""Which thing goes where: a problem taken apart, things added, and all of it laid out anew."""

from robotouille.generation.layout.arrangement import Arrangement, arrange
from robotouille.generation.layout.decomposition import ProblemParts, StackItem, Thing
from robotouille.generation.layout.floorplan import Floorplan, lay_out, size_for
from robotouille.generation.layout.stock import Stock
from robotouille.generation.layout.type_roles import Roles

__all__ = [
    "Arrangement",
    "Floorplan",
    "ProblemParts",
    "Roles",
    "StackItem",
    "Stock",
    "Thing",
    "arrange",
    "lay_out",
    "size_for",
]
