"""Recordings as films: frames of a sequence of states, and files of frames."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pygame

from robotouille.domain.rendering import RenderingFile
from robotouille.errors import MissingExtraError
from robotouille.world.world import State
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.view import Bubble, SeatView, View

if TYPE_CHECKING:
    import av

__all__ = ["VIDEOS", "frames_of", "write_video", "writing_video"]

VIDEOS = (".mp4", ".gif")
_PALETTE_FRAMES = 48


def frames_of(
    states: Iterable[tuple[int, State]],
    *,
    size: tuple[int, int] = (1280, 720),
    frames_per_step: int = 6,
    seats: Sequence[Sequence[SeatView]] = (),
    bubbles: dict[int, tuple[Bubble, ...]] | None = None,
    notices: dict[int, str] | None = None,
    max_steps: int | None = None,
    outcome: str = "",
    hold: int = 12,
    rendering: str | RenderingFile = "",
    pictures: Path | None = None,
) -> Iterator[pygame.Surface]:
    """Draw a course of (step, state) with some frames for each step.

    `seats` are those at each state. The first state is shown standing still, the last one for
    `hold` frames more, with the outcome; `rendering` and `pictures` are those of Painter. The same
    surface is yielded each time: use it before asking for the next.
    """
    painter, surface = Painter(rendering, pictures), pygame.Surface(size)
    previous: State | None = None
    view: View | None = None
    for index, (step, state) in enumerate(states):
        view = View(
            world=state.world,
            state=state,
            previous=previous,
            step=step,
            max_steps=max_steps,
            seats=tuple(seats[min(index, len(seats) - 1)]) if seats else (),
            bubbles=(bubbles or {}).get(step, ()),
            notice=(notices or {}).get(step, ""),
        )
        for frame in range(frames_per_step):
            phase = (frame + 1) / frames_per_step
            painter.paint(surface, _at(view, phase))
            yield surface
        previous = state
    if view is not None and hold:
        painter.paint(surface, _at(view, 1.0, outcome, won=view.state.goal_reached))
        yield from itertools.repeat(surface, hold)


def _at(view: View, phase: float, outcome: str = "", *, won: bool = False) -> View:
    return replace(view, phase=phase, outcome=outcome, won=won, lost=bool(outcome) and not won)


def write_video(path: Path | str, frames: Iterable[pygame.Surface], fps: int = 30) -> int:
    """Write frames of one size as .mp4 (H.264) or .gif; how many there were.

    Raises MissingExtraError without PyAV, ValueError for another ending or no frames, OSError
    where they cannot be written.
    """
    return deque(writing_video(path, frames, fps), maxlen=1).pop()


def writing_video(
    path: Path | str, frames: Iterable[pygame.Surface], fps: int = 30
) -> Iterator[int]:
    """Write a video as `write_video` does, a frame at a time: how many are written so far.

    Some of them are still on their way to the file, which is whole only at the end.
    """
    path = Path(path)
    if path.suffix.lower() not in VIDEOS:
        raise ValueError(f"a video's name ends in {' or '.join(VIDEOS)}, found {path.name!r}")
    try:
        import av
    except ImportError:
        raise MissingExtraError("writing a video", "video") from None
    video_frames = (_frame(av, surface) for surface in frames)
    first = next(video_frames, None)
    if first is None:
        raise ValueError("a video needs at least one frame")
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    try:
        yield from write(path, itertools.chain([first], video_frames), first, fps)
    except OSError:
        raise
    except av.FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error


def _frame(av_: Any, surface: pygame.Surface) -> av.VideoFrame:
    width, height = surface.get_size()
    even = surface.subsurface((0, 0, width - width % 2, height - height % 2))
    frame: av.VideoFrame = av_.VideoFrame(*even.get_size(), "rgba")
    plane = frame.planes[0]
    plane.update(pygame.image.tobytes(even, "RGBA", False, plane.line_size))
    return frame


def _write_mp4(
    path: Path, frames: Iterable[av.VideoFrame], first: av.VideoFrame, fps: int
) -> Iterator[int]:
    import av

    with av.open(str(path), "w", options={"movflags": "+faststart"}) as container:
        stream: Any = container.add_stream("libx264", rate=fps)
        stream.width, stream.height = first.width, first.height
        stream.pix_fmt = "yuv420p"
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
    """One palette for all frames, chosen from the first: what stands still then costs nothing."""
    import av

    frames = iter(frames)
    opening = list(itertools.islice(frames, _PALETTE_FRAMES))
    graph = _palette_graph(av, _palette(av, opening[::4], fps), first, fps)
    count = 0
    with av.open(str(path), "w") as container:
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
    """The 256 colours that show some frames best, as a picture of 16 × 16."""
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
    """A graph that maps frames to the colours of a palette."""
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
