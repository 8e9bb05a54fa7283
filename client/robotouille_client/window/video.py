"""Still pictures of states, frames of replays, and video files."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pygame

from robotouille.domain.rendering import RenderingFile
from robotouille.errors import MissingExtraError
from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.gestures import CHEER_SECONDS
from robotouille_client.window.drawing.painter import Painter, paint
from robotouille_client.window.view import Bubble, SeatView, View

if TYPE_CHECKING:
    import av

VIDEOS = (".mp4", ".gif")
# Frames from which the palette of a GIF is chosen.
_PALETTE_FRAMES = 48


@dataclass(frozen=True, slots=True)
class FilmOptions:
    """Options of a film: what it shows besides states, and how.

    Attributes:
        size: Width and height in pixels.
        frames_per_step: Frames for each step.
        fps: Frames for each second.
        hold: Frames for which the last state stays, with the outcome.
        seats: Returns the seats at a step.
        bubbles: Returns the speech bubbles at a step.
        notices: Line at the top of the kitchen, by step.
        max_steps: Step limit of the game.
        outcome: How the game ended.
        rendering: Rendering, or the name of one. Default: the domain's own.
        pictures: Folder that is searched for pictures first.
    """

    size: tuple[int, int] = (1280, 720)
    frames_per_step: int = 6
    fps: int = 24
    hold: int = 12
    seats: Callable[[int], tuple[SeatView, ...]] = lambda step: ()
    bubbles: Callable[[int], tuple[Bubble, ...]] = lambda step: ()
    notices: Mapping[int, str] = field(default_factory=dict)
    max_steps: int | None = None
    outcome: str = ""
    rendering: str | RenderingFile = ""
    pictures: Path | None = None


def frames_of(
    states: Iterable[tuple[int, State]], options: FilmOptions = FilmOptions()
) -> Iterator[pygame.Surface]:
    """Draw (step, state) pairs as frames; the first state stands still.

    All frames are the same surface. Use one before asking for the next.
    """
    painter = Painter(options.rendering, options.pictures)
    surface = pygame.Surface(options.size)
    frames = itertools.count()
    previous: State | None = None
    view: View | None = None

    def painted(view: View) -> pygame.Surface:
        painter.paint(surface, replace(view, seconds=next(frames) / options.fps))
        return surface

    for step, state in states:
        view = View(
            world=state.world,
            state=state,
            previous=previous,
            step=step,
            max_steps=options.max_steps,
            seats=options.seats(step),
            bubbles=options.bubbles(step),
            notice=options.notices.get(step, ""),
            step_seconds=options.frames_per_step / options.fps,
        )
        for frame in range(options.frames_per_step):
            yield painted(replace(view, phase=(frame + 1) / options.frames_per_step))
        previous = state
    if view is not None:
        won = view.state.goal_reached
        lost = bool(options.outcome) and not won
        for frame in range(options.hold):
            since = frame / options.fps if options.outcome else None
            # The outcome would cover the players while they cheer.
            outcome = "" if since is None or since < CHEER_SECONDS else options.outcome
            yield painted(replace(view, outcome=outcome, won=won, lost=lost, since_end=since))


def write_video(
    path: Path | str, frames: Iterable[pygame.Surface], fps: int = 30, kind: str = ""
) -> Iterator[int]:
    """Write frames of one size as .mp4 (H.264) or .gif, and yield the number written so far.

    The encoder holds some frames back, so that the file is complete only at the end.

    Args:
        kind: `.mp4` or `.gif`. Default: the suffix of `path`.

    Raises:
        MissingExtraError: PyAV is not installed.
        ValueError: The suffix is another one, or there are no frames.
        OSError: The file cannot be written.
    """
    path = Path(path)
    kind = (kind or path.suffix).lower()
    if kind not in VIDEOS:
        raise ValueError(
            f"the name of a video must end in {' or '.join(VIDEOS)}, not {path.name!r}"
        )
    try:
        import av
    except ImportError:
        raise MissingExtraError("writing a video", "video") from None
    video_frames = (_frame(av, surface) for surface in frames)
    first = next(video_frames, None)
    if first is None:
        raise ValueError("a video needs at least one frame")
    write = _write_gif if kind == ".gif" else _write_mp4
    try:
        yield from write(path, itertools.chain([first], video_frames), first, fps)
    except OSError:
        raise
    except av.FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error


def _frame(av_: Any, surface: pygame.Surface) -> av.VideoFrame:
    width, height = surface.get_size()
    # H.264 in yuv420p needs even sides.
    even = surface.subsurface((0, 0, width - width % 2, height - height % 2))
    frame: av.VideoFrame = av_.VideoFrame(*even.get_size(), "rgba")
    plane = frame.planes[0]
    plane.update(pygame.image.tobytes(even, "RGBA", False, plane.line_size))
    return frame


def _write_mp4(
    path: Path, frames: Iterable[av.VideoFrame], first: av.VideoFrame, fps: int
) -> Iterator[int]:
    import av

    # With the index at the front, a browser can play the video while it loads.
    with av.open(str(path), "w", "mp4", options={"movflags": "+faststart"}) as container:
        stream: Any = container.add_stream("libx264", rate=fps)
        stream.width, stream.height = first.width, first.height
        stream.pix_fmt = "yuv420p"
        # Flat colours and sharp edges compress well with the tuning for animation.
        stream.options = {"crf": "20", "preset": "veryfast", "tune": "animation"}
        for count, frame in enumerate(frames, 1):
            _stamp(frame, count - 1, fps)
            container.mux(stream.encode(frame))
            yield count
        container.mux(stream.encode())


def _stamp(frame: av.VideoFrame, index: int, fps: int) -> None:
    frame.pts = index
    frame.time_base = Fraction(1, fps)


def _write_gif(
    path: Path, frames: Iterable[av.VideoFrame], first: av.VideoFrame, fps: int
) -> Iterator[int]:
    """Write a GIF. All frames share one palette, so that unchanged parts cost no bytes."""
    import av

    frames = iter(frames)
    # A palette from all frames would mean drawing the whole game twice.
    opening = list(itertools.islice(frames, _PALETTE_FRAMES))
    graph = _palette_graph(av, _palette(av, opening[::4], fps), first, fps)
    count = 0
    with av.open(str(path), "w", "gif") as container:
        stream: Any = container.add_stream("gif", rate=fps)
        stream.width, stream.height = first.width, first.height
        stream.pix_fmt = "pal8"
        for frame in itertools.chain(opening, frames, [None]):
            if frame is not None:
                _stamp(frame, count, fps)
                count += 1
            graph.inputs[0].push(frame)
            for mapped in _pulled(av, graph.output):
                container.mux(stream.encode(mapped))
            yield count
        container.mux(stream.encode())


class _Graph(NamedTuple):
    graph: Any
    inputs: tuple[Any, ...]
    output: Any


def _palette(av_: Any, frames: list[av.VideoFrame], fps: int) -> av.VideoFrame:
    """Return the best 256 colours for some frames, as a picture of 16 × 16."""
    graph = av_.filter.Graph()
    source = _input(graph, frames[0], fps)
    chooser, sink = graph.add("palettegen", "stats_mode=full"), graph.add("buffersink")
    source.link_to(chooser)
    chooser.link_to(sink)
    graph.configure()
    for index, frame in enumerate(frames):
        _stamp(frame, index, fps)
        source.push(frame)
    source.push(None)
    palette: av.VideoFrame = sink.pull()
    return palette


def _palette_graph(av_: Any, palette: av.VideoFrame, first: av.VideoFrame, fps: int) -> _Graph:
    """Return a filter graph that maps frames to the colours of a palette."""
    graph = av_.filter.Graph()
    inputs = (_input(graph, first, fps), _input(graph, palette, fps))
    mapper = graph.add("paletteuse", "dither=none:diff_mode=rectangle")
    sink = graph.add("buffersink")
    inputs[0].link_to(mapper, 0, 0)
    inputs[1].link_to(mapper, 0, 1)
    mapper.link_to(sink)
    graph.configure()
    _stamp(palette, 0, fps)
    inputs[1].push(palette)
    inputs[1].push(None)
    return _Graph(graph, inputs, sink)


def _input(graph: Any, like: av.VideoFrame, fps: int) -> Any:
    return graph.add_buffer(
        width=like.width, height=like.height, format=like.format.name, time_base=Fraction(1, fps)
    )


def _pulled(av_: Any, sink: Any) -> Iterator[av.VideoFrame]:
    while True:
        try:
            yield sink.pull()
        except (av_.error.BlockingIOError, av_.error.EOFError):
            return


SIZE = (960, 540)


def still(state: State, step: int, size: tuple[int, int] = SIZE) -> Any:
    """Return the picture of a state as a NumPy array of bytes, (height, width, 3)."""
    surface = pygame.Surface(size)
    paint(surface, View(world=state.world, state=state, step=step))
    return pygame.surfarray.array3d(surface).swapaxes(0, 1).copy()
