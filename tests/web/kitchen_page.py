"""Pages with only the browser client's kitchen, and the window's pictures of the same states.

To look at games: `python -m tests.web.kitchen_page TASK... --out FOLDER` writes pictures of both.
"""

from __future__ import annotations

import argparse
import base64
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame

from robotouille import State, Task, World, load_task
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import rendering_of
from robotouille.planning.plan import read_plan
from robotouille.protocol.states import StateWriter
from robotouille.web.site import STATIC, look_files
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.view import View

__all__ = [
    "CHROMIUM", "FLAGS", "MARGIN", "kitchen_page", "look_of", "planned_game", "recorded",
    "web_picture", "window_picture",
]  # fmt: skip

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--headless", "--disable-gpu", "--no-first-run", "--disable-sync"]
SITE = "http://kitchen.test/"
MARGIN = 8
"""Pixels around the kitchen in both programs."""
PAGE = """<!doctype html><style>html, body { margin: 0; background: #26222b } </style>
<canvas id="kitchen"></canvas><script type="module">
import { Task } from "./rules/task.js";
import { State } from "./rules/state.js";
import { Look } from "./kitchen/look.js";
import { Kitchen } from "./kitchen/painter.js";
const canvas = document.getElementById("kitchen");
window.begin = async ({ task, snapshot, deltas, look, me }, width, height, ratio) => {
  const own = new Task(task);
  const states = [State.fromSnapshot(own, snapshot)];
  for (const delta of deltas) states.push(states[states.length - 1].after(delta));
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const pictures = new Map(Object.entries(look.pictures));
  const kitchen = new Kitchen(canvas, own, new Look({ ...look, pictures }), me);
  await kitchen.ready;
  kitchen.resize(width, height, ratio);
  Object.assign(window, { kitchen, states });
};
window.paint = async (step, phase) => {
  const before = step > 0 ? states[step - 1] : null;
  // At this time, nobody blinks.
  kitchen.show(states[step], { step, before, stepSeconds: 1, receivedAt: 1 });
  // Tiles for kinds without a picture are decoded when they are needed.
  for (let i = 0; i < 3; i += 1) {
    kitchen.draw(1 + phase);
    await new Promise((done) => setTimeout(done, 20));
  }
};
window.picture = () => {
  const [left, top, width, height] = kitchen.layout.kitchen;
  const part = Object.assign(document.createElement("canvas"), { width, height });
  part.getContext("2d").drawImage(canvas, -left, -top);
  return part.toDataURL();
};
window.timings = async () => {
  const found = [];
  for (let step = 1; step < states.length; step += 1) {
    const moment = { step, before: states[step - 1], stepSeconds: 1, receivedAt: step };
    kitchen.show(states[step], moment);
    for (let frame = 0; frame < 12; frame += 1) {
      // What a frame has recorded is drawn before the next one.
      await new Promise(requestAnimationFrame);
      const begun = performance.now();
      const drawn = kitchen.draw(step + frame / 12);
      if (drawn) found.push(performance.now() - begun);
    }
  }
  return found;
};
window.loaded = true;
</script>"""


def planned_game(task: Task, most: int = 200) -> list[State]:
    """Return the states of a task's shipped plan; without a plan, the first state only."""
    world = World(task)
    states, name = [world.initial], task.name.rpartition("/")[2]
    names = (f"{name}@{task.seats}.plan", f"{name}.plan") if task.folder else ()
    plan = next(
        (task.folder / n for n in names if task.folder and (task.folder / n).is_file()), None
    )
    if plan is not None:
        for joint in list(read_plan(plan.read_text(encoding="utf-8"), world))[:most]:
            states.append(states[-1].step(list(joint)).state)
    return states


def look_of(task: Task) -> dict[str, Any]:
    """Return a task's look as the page gets it: rendering, bindings and pictures."""
    rendering = rendering_of(task)
    pictures: dict[str, str] = {}
    for folder in reversed(rendering.folders(task.folder)):
        pictures |= {path.name: path.read_text() for path in sorted(folder.glob("*.svg"))}
    return {**look_files(rendering, bindings_of(task)), "pictures": pictures}


def recorded(states: Sequence[State], look: dict[str, Any]) -> dict[str, Any]:
    """Return states as the messages of a server, with a look."""
    world = states[0].world
    writer = StateWriter(world)
    snapshot = {"step": 0, **writer.tables(states[0]), **writer.values(states[0])}
    deltas = [
        {"step": number, **writer.changes(before, after)}
        for number, (before, after) in enumerate(pairwise(states), 1)
    ]
    return {
        "task": world.task.json, "snapshot": snapshot, "deltas": deltas, "look": look,
        "me": world.players[0],
    }  # fmt: skip


@contextmanager
def kitchen_page(size: tuple[int, int] = (1280, 720), ratio: float = 1.0) -> Iterator[Any]:
    """Open a page that draws the kitchens given to its function `begin`."""
    from playwright.sync_api import sync_playwright

    def answer(route: Any) -> None:
        name = route.request.url.removeprefix(SITE)
        if not name:
            route.fulfill(body=PAGE, content_type="text/html; charset=utf-8")
        elif (STATIC / name).is_file():
            route.fulfill(path=STATIC / name, content_type="text/javascript; charset=utf-8")
        else:
            route.fulfill(status=404, body="")

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        viewport: Any = {"width": size[0], "height": size[1]}
        page = browser.new_page(viewport=viewport, device_scale_factor=ratio)
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.route(f"{SITE}**", answer)
        page.goto(SITE)
        page.wait_for_function("window.loaded")
        yield page
        browser.close()
    assert errors == []


def web_picture(page: Any, states: Sequence[State], step: int, phase: float) -> pygame.Surface:
    """Return the wall and the floor of the page's picture of a step that `begin` has received."""
    # Walks begin in earlier steps, so that these are drawn too.
    for number in range(max(0, step - 12), step + 1):
        page.evaluate("([step, phase]) => paint(step, phase)", [number, phase])
    content = page.evaluate("picture()").partition(",")[2]
    return pygame.image.load(BytesIO(base64.b64decode(content)), "picture.png")


def window_picture(
    states: Sequence[State], step: int, phase: float, size: tuple[int, int], me: str | None = None
) -> pygame.Surface:
    """Return the wall and the floor of the window's picture of a step."""
    painter, world = Painter(), states[0].world
    surface = pygame.Surface(size)
    # Walks begin in earlier steps, so that these are drawn too.
    for number in range(max(0, step - 12), step + 1):
        before = states[number - 1] if number else None
        view = View(world, states[number], before, number, 0, "", phase, (), me, step_seconds=1.0)
        painter.paint(surface, view)
    area = painter.layout(size, world).kitchen
    return surface.subsurface(area.clip(surface.get_rect())).copy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="+", metavar="TASK")
    parser.add_argument("--out", type=Path, default=Path("kitchens"))
    parser.add_argument("--steps", type=int, nargs="*", default=[0, 7, 20])
    parser.add_argument("--phase", type=float, default=0.6)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720))
    parser.add_argument("--ratio", type=float, default=1.0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with kitchen_page(tuple(options.size), options.ratio) as page:
        for name in options.tasks:
            task = load_task(name)
            states = planned_game(task)
            game = recorded(states, look_of(task))
            page.evaluate(
                "([game, ...size]) => begin(game, ...size)", [game, *options.size, options.ratio]
            )
            stem = name.replace("/", "-")
            for step in options.steps:
                number = min(step, len(states) - 1)
                web_picture(page, states, number, options.phase)
                page.screenshot(path=options.out / f"{stem}-{number}-web.png")
                window = window_picture(
                    states, number, options.phase, (1280, 720), states[0].world.players[0]
                )
                pygame.image.save(window, options.out / f"{stem}-{number}-window.png")
            timings = sorted(page.evaluate("timings()"))
            if timings:
                middle, late = timings[len(timings) // 2], timings[len(timings) * 95 // 100]
                print(f"{name}: {len(timings)} frames, {middle:.2f} ms, 95 % below {late:.2f} ms, "
                      f"most {timings[-1]:.2f} ms")  # fmt: skip


if __name__ == "__main__":
    main()
