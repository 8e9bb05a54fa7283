"""Measure the browser client: its first picture, frames, steps, memory, replays, cost to rooms.

python -m benchmarks.page [--parts load play replay rooms]

The first pictures pass through a link of 100 ms and 10 Mbit/s that this program simulates: new TCP
connections take a round trip, and all connections share the bandwidth. Frames are drawn in
software. Run the benchmark on an idle machine. Needs chromium and playwright.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.request import urlopen

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import psutil
from rich.console import Console
from rich.table import Table

from benchmarks.viewer import long_recording
from benchmarks.window import course
from robotouille.episode import Clock
from robotouille.protocol import messages
from robotouille.protocol.states import StateWriter
from robotouille.replay.recording import recording_of
from robotouille.web.recording_page import replay_page
from robotouille_server import Server, ServerSettings, serve
from robotouille_server.runtime.logs import configure_logs

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--headless", "--disable-gpu", "--no-first-run"]
SIZE = {"width": 1280, "height": 720}
ROUND_TRIP, BYTES_PER_SECOND = 0.1, 10_000_000 / 8
FIRST_TASK = "multi_agent/01"
STEP_RATE, HOUR, DELTAS = 5, 18_000, 500
COUNTDOWN = 3.0
"""Seconds before a game, in which pages draw pictures ahead."""
FRAME = 1000 / 60
"""Milliseconds between two frames."""


@dataclass(frozen=True, slots=True)
class Row:
    """Result with its target; `met` is None without a target."""

    name: str
    result: str
    target: str = ""
    met: bool | None = None


# The first picture


@dataclass(slots=True)
class Link:
    """Network link in front of a server, with a delay and a bandwidth.

    Attributes:
        down: Bytes sent to the browser, without those of TCP and IP.
        connections: Connections of the browser.
    """

    port: int
    down: int = 0
    connections: int = 0
    _free: dict[bool, float] = field(default_factory=dict)
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    async def carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry a connection of the browser to the server."""
        self.connections += 1
        there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self.port)
        for flow in (
            # The first data follows a handshake.
            self._flow(reader, there_writer, False, time.monotonic() + ROUND_TRIP),
            self._flow(there_reader, writer, True, 0.0),
        ):
            self._start(flow)

    async def _flow(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, down: bool, opened: float
    ) -> None:
        queue: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        self._start(_deliver(queue, writer))
        data = b"-"
        with suppress(ConnectionError):
            while data:
                data = await reader.read(8192)
                begun = max(time.monotonic(), opened, self._free.get(down, 0.0))
                self._free[down] = begun + len(data) / BYTES_PER_SECOND
                if down:
                    self.down += len(data)
                queue.put_nowait((self._free[down] + ROUND_TRIP / 2, data))
        queue.put_nowait((0.0, b""))

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


async def _deliver(queue: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter) -> None:
    with suppress(ConnectionError):
        try:
            while True:
                at, data = await queue.get()
                if not data:
                    break
                await asyncio.sleep(max(0.0, at - time.monotonic()))
                writer.write(data)
                await writer.drain()
        finally:
            writer.close()
            await writer.wait_closed()


@asynccontextmanager
async def linked(port: int) -> AsyncIterator[tuple[Link, int]]:
    """Open a link to a server; yield it with its port."""
    link = Link(port)
    door = await asyncio.start_server(link.carry, "127.0.0.1", 0)
    async with door:
        yield link, door.sockets[0].getsockname()[1]
        await link.close()


ENTER = """
localStorage.setItem("robotouille.name", "Ada");
const drawImage = CanvasRenderingContext2D.prototype.drawImage;
CanvasRenderingContext2D.prototype.drawImage = function (...given) {
  if (this.canvas.id === "kitchen") window.firstPicture ??= performance.now();
  return drawImage.apply(this, given);
};
new MutationObserver(() => {
  const form = document.getElementById("enter");
  if (!form || form.hidden || window.entered) return;
  window.entered = performance.now();
  document.getElementById("enter-form").requestSubmit();
}).observe(document, { subtree: true, childList: true, attributes: true });
"""
"""Enters at once, and notes when the form and the first picture appeared."""


async def measure_load(browser: Any, server: Server, times: int) -> list[Row]:
    """Open a kitchen with an empty cache through the link."""
    forms, pictures, sizes, requests = [], [], [], 0
    for _ in range(times):
        room = server.lobby.create(messages.Create(task=FIRST_TASK, clock=Clock.REALTIME))
        async with linked(server.port) as (link, port):
            context = await browser.new_context(viewport=SIZE, bypass_csp=True)
            await context.add_init_script(ENTER)
            page = await context.new_page()
            await page.goto(f"http://127.0.0.1:{port}/play#{room.code}")
            await page.wait_for_function("window.firstPicture", timeout=20_000)
            found = await page.evaluate("[window.entered, window.firstPicture]")
            forms.append(found[0])
            pictures.append(found[1])
            sizes.append(link.down / 1024)
            requests = link.connections
            await context.close()
    form, picture, size = map(statistics.median, (forms, pictures, sizes))
    return [
        Row("form, empty cache, 100 ms and 10 Mbit/s", f"{form:,.0f} ms"),
        Row("first picture of a game, after the link", f"{picture:,.0f} ms", "< 2,000 ms",
            picture < 2000),
        Row("bytes to the browser until then", f"{size:.0f} KiB", "≤ 120 KiB", size <= 120),
        Row("connections until then", f"{requests}"),
    ]  # fmt: skip


# A game


def played() -> dict[str, Any]:
    """Return the largest task's game as the messages of a server. Its states repeat."""
    states = [course()[0][0], *(after for _, after in course())]
    world = states[0].world
    writer = StateWriter(world)
    largest = max(states, key=lambda state: state.facts.bit_length())
    seats = [
        {"player": name, "name": name.title(), "kind": "human", "present": True, "ready": True,
         "controller": "participant"}
        for name in world.players
    ]  # fmt: skip
    snapshot = {
        "type": "snapshot", "step": 0, "task": world.task.json, "digest": "task",
        "clock": {"clock": "realtime", "step_rate": STEP_RATE, "max_steps": HOUR},
        "phase": "running", "seats": seats, **writer.tables(largest), **writer.values(states[0]),
    }  # fmt: skip
    deltas = []
    for each in pairwise([*states, states[0]]):
        changes = writer.changes(*each)
        # In a game, objects are created once. Here they vanish when the states repeat.
        added = {name: changes[name] for name in changes if name not in ("objects", "atoms")}
        deltas.append({"type": "delta", **added})
    return {"me": world.players[0], "snapshot": snapshot, "deltas": deltas}


SIMULATED = """
localStorage.setItem("robotouille.name", "Ada");
const game = GAME;
let step = 0;
window.frames_ = [];
window.applied = [];
const request = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (frame) => request((at) => {
  const begun = performance.now();
  frame(at);
  window.frames_.push([at, performance.now() - begun]);
});
const stroke = CanvasRenderingContext2D.prototype.stroke;
CanvasRenderingContext2D.prototype.stroke = function (...given) {
  if (this.canvas.id === "kitchen" && this.strokeStyle === "#fffaf0") window.marked = true;
  return stroke.apply(this, given);
};
window.WebSocket = class {
  static OPEN = 1;
  constructor() {
    this.readyState = 1;
    window.socket = this;
    setTimeout(() => this.onopen());
  }
  tell(message) { this.onmessage({ data: JSON.stringify(message) }); }
  send(text) {
    const { type, ref } = JSON.parse(text);
    if (type === "hello") this.tell({ type: "welcome", resume: "a" });
    else if (type === "get_rendering") setTimeout(() => this.tell({ type: "rendering", ref }));
    else if (type === "join") {
      this.tell({ type: "joined", episode: "E", code: "KQXZB-MHTWA", role: "player",
        seat: game.me, name: "Ada", step: 0, seq: 0 });
      this.tell(game.snapshot);
    }
  }
  close() {}
};
window.feed = () => {
  const data = JSON.stringify({ ...game.deltas[step % game.deltas.length], step: step + 1 });
  step += 1;
  const begun = performance.now();
  window.socket.onmessage({ data });
  window.applied.push(performance.now() - begun);
  if (step % 50 === 0) window.socket.tell({ type: "said", number: step, step, name: "Ben",
    seat: game.snapshot.seats[1].player, text: `This was step ${step}.` });
};
window.play = async (seconds, rate) => {
  const timer = setInterval(window.feed, 1000 / rate);
  await new Promise((done) => setTimeout(done, seconds * 1000));
  clearInterval(timer);
};
window.rush = (steps) => {
  for (let i = 0; i < steps; i += 1) window.feed();
};
window.hurry = async (steps) => {
  for (let i = 0; i < steps; i += 1) {
    window.feed();
    if (i % 20 === 19) await new Promise(request);
  }
};
window.press = async (key) => {
  await new Promise(request);
  window.marked = false;
  document.getElementById("kitchen").dispatchEvent(
    new KeyboardEvent("keydown", { key, bubbles: true }));
  let frames = 0;
  while (!window.marked && frames < 10) {
    await new Promise(request);
    frames += 1;
  }
  return window.marked ? frames : null;
};
"""
"""Replaces the server by messages of a game, and notes how long the page works on them."""


async def measure_game(browser: Any, server: Server, seconds: float, hour: int) -> list[Row]:
    """Play a game of the largest task in the page, without a server."""
    context = await browser.new_context(viewport=SIZE, bypass_csp=True)
    await context.add_init_script(SIMULATED.replace("GAME", json.dumps(played())))
    page = await context.new_page()
    page.on("pageerror", lambda error: print(f"error in the page: {error}", file=sys.stderr))
    tools = await context.new_cdp_session(page)
    await page.goto(f"http://127.0.0.1:{server.port}/play#KQXZB-MHTWA")
    await page.click("#enter-button")
    await page.wait_for_selector("#choices li")
    await page.wait_for_timeout(1000 * COUNTDOWN)
    press = None
    for key in "wasd":  # There may be nothing to walk to in the first directions.
        press = press or await page.evaluate("press", key)
    await page.evaluate("frames_.length = 0")
    await browser.start_tracing(page=page, categories=["devtools.timeline"])
    await page.evaluate(f"play({seconds}, {STEP_RATE})")
    trace = json.loads(await browser.stop_tracing())["traceEvents"]
    frames = await page.evaluate("frames_")
    spent = sorted(
        each["tdur"] / 1000
        for each in trace
        if each["name"] == "FireAnimationFrame" and "tdur" in each
    )
    rushing = await _task_time(tools, page, f"rush({DELTAS})") / DELTAS
    work = sorted(spent for _, spent in frames)
    gaps = [later[0] - sooner[0] for sooner, later in pairwise(frames)]
    # A gap of two frames is a frame that was late.
    on_time = sum(gap < 1.5 * FRAME for gap in gaps) / len(gaps)
    short = sum(spent < FRAME for spent in work) / len(work)
    await page.evaluate("applied.length = 0")
    heaps = []
    applied: list[float] = []
    for _ in range(5):
        await page.evaluate(f"hurry({hour // 5})")
        applied += await page.evaluate("applied.splice(0)")
        await page.evaluate("frames_.length = 0")
        heaps.append(await _heap(tools))
    applied.sort()
    await context.close()
    late, growth = _share(spent, 0.99), heaps[-1] / heaps[-3] - 1
    return [
        Row("processor time of a frame, 1280 × 720", f"{statistics.median(spent):.1f} ms, 99 % "
            f"under {late:.1f} ms", "99 % < 4 ms", late < 4),
        Row("frames with less than 16.7 ms of script", f"{short:.1%}", "99 %", short >= 0.99),
        Row("frames that no frame before delayed", f"{on_time:.1%}"),
        Row("delta applied and choices listed", f"{statistics.median(applied):.1f} ms, 99 % under "
            f"{_share(applied, 0.99):.1f} ms"),
        Row("processor time of a delta", f"{rushing:.2f} ms", "< 2 ms", rushing < 2),
        Row(f"heap after {hour * 3 // 5:,} and {hour:,} steps", f"{heaps[-3] / 2**20:.2f} and "
            f"{heaps[-1] / 2**20:.2f} MiB", "flat", growth < 0.05),
        Row("frames from a key to the mark", f"{press}", "1", press == 1),
    ]  # fmt: skip


async def _task_time(tools: Any, page: Any, work: str) -> float:
    """Return the milliseconds of processor time that the page takes for some work."""
    await tools.send("Performance.enable", {"timeDomain": "threadTicks"})
    before = await _processor_time(tools)
    await page.evaluate(work)
    return await _processor_time(tools) - before


async def _processor_time(tools: Any) -> float:
    """Return the milliseconds of processor time that the page has taken so far."""
    metrics = (await tools.send("Performance.getMetrics"))["metrics"]
    seconds = next(each["value"] for each in metrics if each["name"] == "TaskDuration")
    return 1000 * float(seconds)


async def _heap(tools: Any) -> float:
    await tools.send("HeapProfiler.collectGarbage")
    return float((await tools.send("Runtime.getHeapUsage"))["usedSize"])


def _share(ordered: Sequence[float], share: float) -> float:
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]


# Replay

SEEKS = 200
SEEK = f"""
for (let i = 0; i < {SEEKS}; i += 1) {{
  robotouille.player.seek(Math.floor(Math.random() * robotouille.player.end));
  robotouille.frame(performance.now() / 1000);
}}
"""
"""Seeks and draws random steps."""


async def measure_replay(browser: Any, steps: int) -> list[Row]:
    """Open the page of a long recording of four players from disk."""
    recording = recording_of(long_recording(steps), "the long recording")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.html"
        path.write_text(replay_page([("", recording)]), encoding="utf-8")
        size = path.stat().st_size
        context = await browser.new_context(viewport=SIZE, bypass_csp=True)
        page = await context.new_page()
        tools = await context.new_cdp_session(page)
        await tools.send("Performance.enable", {"timeDomain": "threadTicks"})
        await page.goto(path.as_uri())
        await page.wait_for_function("globalThis.robotouille?.readyAt", timeout=60_000)
        opened = await _processor_time(tools)
        ready = await page.evaluate("robotouille.readyAt")
        seek = await _task_time(tools, page, SEEK) / SEEKS
        await context.close()
    most = 300 * 1024 + 20 * steps
    return [
        Row(f"page of {steps:,} steps, to the first picture", f"{ready:,.0f} ms"),
        Row("processor time of it", f"{opened:,.0f} ms", "< 1,000 ms", opened < 1000),
        Row("processor time to seek and draw", f"{seek:.1f} ms", "< 50 ms", seek < 50),
        Row("size of the page", f"{size / 1024:,.0f} KiB", f"≤ {most / 1024:,.0f} KiB",
            size <= most),
    ]  # fmt: skip


# Rooms


@contextmanager
def server_process(folder: str) -> Iterator[tuple[str, psutil.Process]]:
    """Run a server of many rooms; yield its address for browsers, and its process."""
    program = "from robotouille_server.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", program, "--port", "0", "--recordings", folder, "--no-operator",
         "--max-episodes", "1000", "--max-connections-per-address", "5000", "--log-level", "error"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        urls = (re.search(r"ws(://\S+)", line) for line in process.stdout or ())
        found = next((url for url in urls if url), None)
        if found is None:
            raise SystemExit("the server did not start")
        yield f"http{found[1]}", psutil.Process(process.pid)
    finally:
        process.kill()
        process.communicate()


@contextmanager
def load(url: str, rooms: int, seconds: float) -> Iterator[None]:
    """Play in some rooms in another process for at least this time."""
    command = [
        sys.executable, "-m", "robotouille_client.loadtest.cli", "--url", f"ws{url[4:]}",
        "--rooms", str(rooms), "--rate", str(STEP_RATE), "--ramp", "3", "--duration", f"{seconds}",
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def lateness(url: str) -> tuple[float, float]:
    """Return the number of steps and the sum of their lateness in seconds."""
    text = urlopen(f"{url}/metrics", timeout=5).read().decode()
    values = {
        name: float(value)
        for name, value in re.findall(r"robotouille_step_lateness_seconds_(\w+) (\S+)", text)
    }
    return values["count"], values["sum"]


def files_of_page(url: str) -> list[str]:
    """Return the addresses of what a browser with an empty cache requests."""
    text = urlopen(f"{url}/play", timeout=5).read().decode()
    names = dict.fromkeys(re.findall(r'(?:href|src)="(play/[^"]+)"', text))
    version = next(iter(names)).split("/")[1]
    rest = [f"play/{version}/looks/robotouille.json", f"play/{version}/pictures/kitchen.json"]
    return ["play", *names, *rest]


async def load_page(url: str, files: Sequence[str], at_once: int = 6) -> None:
    """Request the files of a page as a browser does, with some connections at once."""
    host = url.removeprefix("http://")
    address, _, port = host.rpartition(":")
    limit = asyncio.Semaphore(at_once)

    async def get(name: str) -> None:
        async with limit:
            reader, writer = await asyncio.open_connection(address, int(port))
            request = f"GET /{name} HTTP/1.1\r\nHost: {host}\r\nAccept-Encoding: gzip\r\n\r\n"
            writer.write(request.encode())
            while await reader.read(65536):
                pass
            writer.close()

    await asyncio.gather(*map(get, files))


async def page_loads(url: str, rate: float, seconds: float) -> int:
    """Load pages at a rate; return how many were complete in time."""
    files = files_of_page(url)
    end, due, loads = time.monotonic() + seconds, time.monotonic(), set()
    done = 0
    while time.monotonic() < end:
        if rate:
            load = asyncio.create_task(load_page(url, files))
            loads.add(load)
            load.add_done_callback(loads.discard)
            done += 1
        due += 1 / rate if rate else seconds
        await asyncio.sleep(max(0.0, min(due, end) - time.monotonic()))
    await asyncio.wait_for(asyncio.gather(*loads), 30)
    return done


async def measure_rooms(rooms: int, seconds: float, pairs: int, rate: float) -> list[Row]:
    """Compare the lateness of steps with and without page loads, in turns."""
    means: dict[float, list[float]] = {0.0: [], rate: []}
    duration = 2 * (pairs + 1) * (seconds + 1) + 20
    with (
        tempfile.TemporaryDirectory() as folder,
        server_process(folder) as (url, process),
        load(url, rooms, duration),
    ):
        await asyncio.sleep(10)
        for _ in range(pairs):
            for each, found in means.items():
                before = lateness(url)
                await page_loads(url, each, seconds)
                after = lateness(url)
                found.append((after[1] - before[1]) / max(1.0, after[0] - before[0]))
        busy = sum(process.cpu_times()[:2])
        loads = await page_loads(url, rate, seconds)
        busy_with = sum(process.cpu_times()[:2]) - busy
        busy = sum(process.cpu_times()[:2])
        await page_loads(url, 0.0, seconds)
        each_load = (busy_with - (sum(process.cpu_times()[:2]) - busy)) / loads
    without, with_loads = (1000 * statistics.median(found) for found in means.values())
    change = with_loads / without - 1
    return [
        Row(f"lateness of a step in {rooms} rooms", f"{without:.2f} ms"),
        Row(f"with {rate:g} page loads a second", f"{with_loads:.2f} ms, {change:+.0%}",
            "within 5 %", change <= 0.05),
        Row("processor time of the server, a page load", f"{1000 * each_load:.1f} ms"),
    ]  # fmt: skip


# All


@asynccontextmanager
async def started() -> AsyncIterator[tuple[Any, Server]]:
    """Start a browser and a server."""
    from playwright.async_api import async_playwright

    configure_logs("error", "console")
    with tempfile.TemporaryDirectory() as folder:
        settings = ServerSettings(port=0, recordings=Path(folder), countdown=0.0)
        async with serve(settings) as server, async_playwright() as driver:
            browser = await driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            yield browser, server
            await browser.close()


async def measured(part: Callable[[Any, Server], Awaitable[list[Row]]]) -> list[Row]:
    async with started() as (browser, server):
        return await part(browser, server)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the results with their targets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts = ("load", "play", "replay", "rooms")
    parser.add_argument("--parts", nargs="+", choices=parts, default=parts)
    parser.add_argument("--times", type=int, default=5, help="page loads through the link")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    parser.add_argument("--hour", type=int, default=HOUR, help="steps of the memory's measurement")
    parser.add_argument("--steps", type=int, default=10_000, help="steps of the replay")
    parser.add_argument("--rooms", type=int, default=100)
    parser.add_argument("--rate", type=float, default=2.0, help="page loads a second")
    options = parser.parse_args(arguments)
    if CHROMIUM is None or find_spec("playwright") is None:
        print("page: skipped; needs chromium and playwright")
        return
    rows: list[Row] = []
    if "load" in options.parts:
        rows += asyncio.run(measured(lambda b, s: measure_load(b, s, options.times)))
    if "play" in options.parts:
        rows += asyncio.run(
            measured(lambda b, s: measure_game(b, s, options.seconds, options.hour))
        )
    if "replay" in options.parts:
        rows += asyncio.run(measured(lambda b, _: measure_replay(b, options.steps)))
    if "rooms" in options.parts:
        rows += asyncio.run(measure_rooms(options.rooms, options.seconds, 3, options.rate))
    table = Table(title="The page in a browser", title_justify="left")
    for title in ("", "result", "target", "met"):
        table.add_column(title)
    for row in rows:
        met = "" if row.met is None else ("yes" if row.met else "no")
        table.add_row(row.name, row.result, row.target, met)
    Console().print(table)


if __name__ == "__main__":
    main()
