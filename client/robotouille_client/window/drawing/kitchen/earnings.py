"""Points that rise from the station where a dish was served."""

from __future__ import annotations

from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.pops import Pop, Pops
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.shapes import pill
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, INK
from robotouille_client.window.view import View

_SECONDS = 1.4


class Earnings:
    """Shows the points of served dishes where the players look, in one kitchen."""

    def __init__(self, text: Typesetter) -> None:
        self._text = text
        self._pops = Pops()

    def follow(self, layout: Layout, view: View) -> None:
        """Start a movement if a dish was served in the step of a view."""
        pop = _earned(self._text, layout, view)
        served = 0 if view.state.orders is None else view.state.orders.served
        self._pops.follow({} if pop is None else {served: pop}, view.seconds)

    @property
    def pops(self) -> Pops:
        """The movements, to draw over the kitchen."""
        return self._pops


def _earned(text: Typesetter, layout: Layout, view: View) -> Pop | None:
    before, now = view.previous, view.state
    if before is None or before.orders is None or now.orders is None:
        return None
    points = now.orders.score - before.orders.score
    station = served_at(before, now) if now.orders.served > before.orders.served else None
    tile = None if station is None else view.world.thing(station).tile
    if tile is None or points <= 0:
        return None
    words = text.line(f"+{points}", 2 * layout.text, INK)
    middle = layout.cell(tile).midtop
    return Pop(pill(words, ACCENT), middle, rises=True, seconds=_SECONDS)


def served_at(before: State, now: State) -> str | None:
    """Return the station at which a dish was served in a step, as far as the states show it."""
    shift = now.world.task.problem.shift
    kind = None if shift is None else shift.serve.station
    world = now.world
    places = [name for name in world.floor.stations if world.thing(name).kind == kind]
    used, left = ({each.host for each in scene(state).values()} for state in (before, now))
    cleared = (name for name in places if name in used and name not in left)
    return next(cleared, places[0] if places else None)
