"""Paints a view: `Painter().paint(surface, view)`. Nothing here reads a clock or an event."""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from pathlib import Path

import pygame

from robotouille.domain.rendering import NO_WORDS, Language, RenderingFile, rendering_of
from robotouille.world.world import State, World
from robotouille_client.window.drawing.cards.interruptions import (
    Interruptions,
    Notices,
    visible_offline,
    visible_pause,
)
from robotouille_client.window.drawing.cards.key_strip import KeyStrip
from robotouille_client.window.drawing.cards.lobby_card import Ground
from robotouille_client.window.drawing.kitchen.animation import (
    Moment,
    StepAnimation,
    step_animation,
)
from robotouille_client.window.drawing.kitchen.earnings import Earnings
from robotouille_client.window.drawing.kitchen.gestures import CHEER_SECONDS, Gesture, Gestures
from robotouille_client.window.drawing.kitchen.kitchen_layer import (
    KitchenLayer,
    Preloader,
    SceneFrame,
)
from robotouille_client.window.drawing.kitchen.overlays import Overlays
from robotouille_client.window.drawing.kitchen.spots import (
    Motion,
    Pose,
    Spot,
    extent,
    occupied,
    spots,
    ways,
    workplaces,
)
from robotouille_client.window.drawing.side_panel.panel import Panel, with_readable_names
from robotouille_client.window.drawing.tags.labels import Labels, LabelSurroundings
from robotouille_client.window.drawing.tags.tips import Listing
from robotouille_client.window.drawing.window_layout import Layout, Strip, UiOverlay, layout
from robotouille_client.window.pictures.appearance import (
    Appearance,
    AppearanceResolver,
    SceneSprites,
)
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import View

# Pictures a second while only steam and sparks move.
_EFFECT_PICTURES = 10


class Painter:
    """Paints views of any world, and caches what the next view will need.

    Paint views in the order of their steps. Any other order works too, but walks of several steps
    are then not drawn.

    Args:
        rendering: Rendering, or the name of a shipped one. Default: the preferred one, or else the
            domain's own.
        pictures: Folder that is searched for pictures first.
        strip: Strip below the kitchen.
        preferences: With reduced motion, nothing moves except from place to place: no hops, no
            steam, no sparks.
        words: Words that replace those of the rendering.
        background: Draw elaborate pictures of `pictures` in another thread, and tiles until then.
    """

    def __init__(
        self,
        rendering: RenderingFile | str | None = None,
        pictures: Path | None = None,
        strip: Strip | None = None,
        *,
        preferences: Preferences = Preferences(),
        words: Language = NO_WORDS,
        background: bool = False,
    ) -> None:
        self._rendering = rendering or preferences.rendering
        self._words = words
        self._pictures = pictures
        self._background = background
        self._strip = strip
        self._preferences = preferences
        self.text = self._text = Typesetter(strong=preferences.strong_contrast)
        self._world: World | None = None
        self._stages: list[tuple[State, SceneSprites]] = []
        self._preloader: Preloader | None = None
        self._animated: tuple[tuple[State, State | None, bool, bool], StepAnimation] | None = None
        self._lesson = ""

    def paint(
        self, surface: pygame.Surface, view: View, ui_overlay: UiOverlay | None = None
    ) -> None:
        """Draw a view on a whole surface, with what only the local player sees on top."""
        ui_overlay = ui_overlay or UiOverlay()
        self._prepare(view.world)
        view = with_readable_names(view, self._text)
        if self._preferences.reduced_motion:
            view = replace(view, seconds=None)
        self._lesson = view.lesson
        place = self.layout(surface.get_size(), view.world)
        frame = self._frame(view, place)
        stage, poses = frame.stage, frame.poses
        surface.blit(self._kitchen.background(place, stage), (0, 0))
        self._overlays.highlight(surface, place, stage, view.hover)
        self._kitchen.draw(surface, place, frame, (view.me, view.companion))
        signs = self._overlays.draw(surface, place, view, stage, poses)
        # Objects on their way have not arrived: until then the ticket shows the state before.
        under_way = frame.animation.travels and view.phase < 1.0
        self._panel.draw(surface, place, view, view.previous if under_way else None)
        ground = self._ground(place, view, frame)
        own = ground.own
        # Cards cover what is marked in the kitchen.
        for mark in ui_overlay.marks:
            self._key_strip.mark(surface, place, stage, mark)
        cards = self._interruptions.draw(surface, place, view, ground)
        choices = self._key_strip.list_area(place, ui_overlay, self._panel.free, own)
        listed = self._listed(view, stage)
        if not ui_overlay.tips:
            ui_overlay = replace(ui_overlay, tips=self.tooltip(ui_overlay.pointer))
            listed = listed or self._panel.listing(ui_overlay.pointer)
        around = LabelSurroundings(
            hovered=extent(place, stage, view.hover, poses) if view.hover else None,
            listed=listed,
            blocked=[
                *occupied(place, stage, poses), *signs, *cards,
                *ways(stage, frame.spots, frame.earlier, frame.animation.travels),
                *self._notices.reserved(place, view, ui_overlay, ground),
                *([] if choices is None else [choices]),
            ],
            avoided=_cells(place, stage),
            spared=workplaces(place, stage, view.world.floor.plain),
            pictures=self._pictured(view, stage),
        )  # fmt: skip
        self._labels.draw(surface, place, view, poses, ui_overlay, around)
        if self._strip is not None:
            self._strip.draw(surface, place.strip, self._text, place.text, view)
        self._key_strip.draw(surface, place, ui_overlay, choices)
        self._notices.draw(surface, place, view, ui_overlay, ground)
        self._earnings.follow(place, view)
        self._earnings.pops.draw(surface, view.seconds)

    def key_at(self, pos: tuple[int, int]) -> str:
        """Return the key that the newest picture shows at a point, or an empty string."""
        return self._key_strip.key_at(pos) if self._world is not None else ""

    def tooltip(self, pointer: tuple[int, int] | None) -> tuple[str, ...]:
        """Return the explanation of what is under the mouse in the newest picture."""
        covered = self._strip is not None and pointer is not None and self._strip.covers(pointer)
        return () if self._world is None or covered else self._panel.tooltip(pointer)

    def _ground(self, place: Layout, view: View, frame: SceneFrame) -> Ground:
        """Return what a card on the kitchen would cover."""
        stage, poses = frame.stage, frame.poses
        players = {player: _around(place, pose) for player, pose in poses.items()}
        return Ground(
            players.get(view.me or ""), tuple(players.values()),
            occupied(place, stage, poses), _cells(place, stage), self._panel.free,
        )  # fmt: skip

    def _pictured(self, view: View, stage: SceneSprites) -> dict[str, Appearance]:
        """Return the looks of the things that bubbles are about."""
        names = {name for bubble in view.bubbles for name in bubble.things}
        looks = {name: self._resolver.pictured(stage, name) for name in names}
        return {name: look for name, look in looks.items() if look is not None}

    def _listed(self, view: View, stage: SceneSprites) -> Listing:
        """Return what is in or on the station under the mouse, if it is more than one object."""
        listed = self._resolver.listing(stage, view.hover) if view.hover else ()
        several = len(listed) > 1 or len(stage.piles.get(view.hover or "", ())) > 1
        return listed if several else ()

    def redraw_key(self, view: View) -> object:
        """Return the visible part of a view. Views with equal keys look the same."""
        self._prepare(view.world)
        pause, offline = view.pause, view.offline
        shown = replace(
            view,
            phase=self._moment(view),
            seconds=None,
            since_end=None,
            pause=None if pause is None else visible_pause(pause),
            offline=None if offline is None else visible_offline(offline),
            starts_in=None if view.starts_in is None else float(ceil(view.starts_in)),
        )
        moving = self._panel.moving(view.seconds), self._earnings.pops.moving(view.seconds)
        return shown, self._gestures_of(view), moving, self._since_end(view)

    def collect_pictures(self) -> int:
        """Take what another thread has drawn; return the number of such pictures so far."""
        return 0 if self._world is None else self._sprites.collect()

    def _moment(self, view: View) -> float:
        """Return the visible phase of a view. Particle effects alone need fewer pictures."""
        before = view.previous
        if before is None:
            return 1.0
        self._poses(view)
        animation = self._animation(view)
        moving = animation.working or animation.emissions or animation.tools
        lively = bool(moving) and not self._preferences.reduced_motion
        if (
            self._motion.walking(view.step)
            or animation.travels
            or before.progress() != view.state.progress()
            or (lively and (animation.working or animation.tools))
        ):
            return view.phase
        # Nothing moves, so that one picture serves for the whole step.
        if not lively:
            return 1.0
        pictures = max(1, round(_EFFECT_PICTURES * (view.step_seconds or 1.0)))
        return int(view.phase * pictures) / pictures

    def _since_end(self, view: View) -> float:
        """Return the visible seconds since the end of a game: its effects last a moment only."""
        if view.since_end is None or self._preferences.reduced_motion:
            return 0.0
        return min(CHEER_SECONDS, int(view.since_end * _EFFECT_PICTURES) / _EFFECT_PICTURES)

    def _time(self, view: View) -> float:
        """Return the time in steps. Stars go on flying while the players cheer."""
        return view.step + view.phase + self._since_end(view) / (view.step_seconds or 1.0)

    def _frame(self, view: View, place: Layout) -> SceneFrame:
        stage, poses, animation = self.stage(view.state), self._poses(view), self._animation(view)
        earlier: dict[str, Spot] = {}
        if animation.travels and view.previous is not None:
            earlier = spots(place, self.stage(view.previous), poses)
        return SceneFrame(
            stage, poses, spots(place, stage, poses), earlier, animation,
            self._gestures_of(view), view.phase, self._time(view),
            not self._preferences.reduced_motion,
        )  # fmt: skip

    def _gestures_of(self, view: View) -> dict[str, Gesture]:
        poses, piles = self._poses(view), self.stage(view.state).piles
        held = {name for name in poses if piles.get(name)}
        return self._gestures.of(view, poses, self._animation(view), held)

    def _animation(self, view: View) -> StepAnimation:
        """Return what moves in the step of a view; the newest answer is cached."""
        before = view.previous
        settled = self._since_end(view) >= CHEER_SECONDS
        key = (view.state, before, view.lost, settled)
        if self._animated is None or self._animated[0] != key:
            now = Moment(view.state, self.stage(view.state))
            earlier = None if before is None else Moment(before, self.stage(before))
            moves = step_animation(self._art, now, earlier, lost=view.lost, settled=settled)
            self._animated = (key, moves)
        return self._animated[1]

    def _poses(self, view: View) -> dict[str, Pose]:
        placed = self.stage(view.state).placed
        before = self.stage(view.previous).placed if view.previous is not None else None
        return self._motion.poses(view.state, placed, before, view.step, view.phase)

    def layout(self, size: tuple[int, int], world: World) -> Layout:
        """Return the layout of a surface, below the lesson that was drawn last."""
        problem = world.task.problem
        lines = 0.0 if self._strip is None else self._strip.lines
        place = layout(size, problem.width, problem.height, lines, self._preferences.text_scale)
        if not self._lesson or world is not self._world:
            return place
        head = self._interruptions.head_lines(place, self._lesson)
        return layout(
            size, problem.width, problem.height, lines, self._preferences.text_scale, head
        )

    def stage(self, state: State) -> SceneSprites:
        """Return everything to draw of a state; the newest few are cached."""
        self._prepare(state.world)
        for known, stage in self._stages:
            if known is state or known == state:  # Equal, too: many steps change nothing.
                return stage
        stage = self._kitchen.stage(state)
        self._stages = [(state, stage), *self._stages[:3]]
        return stage

    def thing_at(self, pos: tuple[int, int], size: tuple[int, int], view: View) -> str | None:
        """Return the station at a point of a surface, or else the uppermost object there."""
        tile, stage = self.layout(size, view.world).tile_at(pos), self.stage(view.state)
        there = [name for name, placed in stage.placed.items() if placed.tile == tile]
        if tile is None or not there:
            return None
        return min(there, key=lambda name: (name not in stage.stations, stage.placed[name].level))

    def preload(self, size: tuple[int, int], seconds: float) -> None:
        """Draw pictures that the task of the last view may need, for about so many seconds."""
        if self._world is None:
            return
        tile = self.layout(size, self._world).tile
        if self._preloader is None or self._preloader.tile != tile:
            self._preloader = Preloader(self._world, self._resolver, self._sprites, tile)
        self._preloader.work(seconds)

    def icon(self, world: World, size: int) -> pygame.Surface | None:
        """Return the window's icon."""
        self._prepare(world)
        return self._sprites.file(self._art.icons.get("app"), size)

    def _prepare(self, world: World) -> None:
        if world is self._world:
            return
        self._world = world
        self._stages = []
        self._animated = None
        self._lesson = ""
        self._preloader = None
        chosen = self._rendering
        art = chosen if isinstance(chosen, RenderingFile) else rendering_of(world.task, chosen)
        language = art.language.with_words(self._words)
        self._art: RenderingFile = art.model_copy(update={"language": language})
        own = () if self._pictures is None else (self._pictures,)
        self._sprites = Sprites(
            (*own, *self._art.folders(world.task.folder)),
            self._text,
            received=self._pictures if self._background else None,
        )
        self._resolver = resolver = AppearanceResolver(world.task.domain, self._art)
        self._kitchen = KitchenLayer(world, resolver, self._sprites)
        self._motion = Motion(world.floor)
        self._gestures = Gestures(still=self._preferences.reduced_motion)
        self._overlays = Overlays(self._art, self._sprites, self._text)
        self._labels = Labels(self._text, self._sprites)
        self._earnings = Earnings(self._text)
        self._panel = Panel(resolver, self._sprites, self._text)
        self._interruptions = Interruptions(self._text)
        self._key_strip = KeyStrip(self._text)
        self._notices = Notices(self._art, self._sprites, self._text)


def _cells(place: Layout, stage: SceneSprites) -> list[pygame.Rect]:
    return [place.cell(t.tile) for name in stage.stations if (t := stage.placed[name]).tile]


def _around(place: Layout, pose: Pose) -> pygame.Rect:
    """Return the area of a player with its head and its name."""
    x, y = place.corner(pose.at)
    side = place.tile
    return pygame.Rect(round(x), round(y - side * 0.4), side, round(side * 1.6))


_painter: list[Painter] = []


def paint(surface: pygame.Surface, view: View) -> None:
    """Draw a view with a painter that all callers of this function share."""
    if not _painter:
        _painter.append(Painter())
    _painter[0].paint(surface, view)
