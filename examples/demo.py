"""Run a server, two bots that cook together, and a window that watches them.

    python examples/demo.py [--task TASK] [--out FOLDER]

The folder receives a verified recording, a picture and a short video.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console

console = Console(highlight=False)
MINUTES = 4


def command(name: str) -> str:
    """Return the path of a command of this installation."""
    found = shutil.which(
        name, path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    )
    if found is None:
        sys.exit(f"{name} is not installed; run: pip install -e '.[all]'")
    return found


def start_server(task: str, recordings: Path) -> tuple[subprocess.Popen[str], str, str]:
    """Start a real-time server on a free port; return its process, URL and the episode's code."""
    arguments = ["--mode", "realtime", "--step-rate", "8", "--port", "0", "--task", task]
    arguments += ["--recordings", str(recordings), "--log-level", "warning"]
    server = subprocess.Popen(
        [command("robotouille-server"), *arguments], stdout=subprocess.PIPE, text=True
    )
    assert server.stdout is not None
    url = code = ""
    for line in server.stdout:
        if found := re.search(r"ws://\S+", line):
            url = url or found.group()
        if found := re.search(r"code is ([A-Z-]+)", line):
            code = found.group(1)
        if "stop:" in line:
            return server, url, code
    sys.exit(f"the server did not start (exit status {server.wait()})")


def stop(process: subprocess.Popen[str]) -> None:
    """Terminate a process; kill it after 10 seconds."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def run(task: str, out: Path, headless: bool) -> None:
    """Play one episode and write its recording, picture and video to `out`."""
    out.mkdir(parents=True, exist_ok=True)
    recordings = out / "recordings"
    shutil.rmtree(recordings, ignore_errors=True)
    server, url, code = start_server(task, recordings)
    processes = [server]
    console.print(f"[bold]server[/]     {url}, real time, 8 steps a second, kitchen {code}")
    page = f"http{url.removeprefix('ws')}/watch#{code}"
    console.print(f"[bold]browser[/]    watch the game at {page}", soft_wrap=True)
    try:
        picture = out / "kitchen.png"
        watch = [command("robotouille-client"), code, "--url", url, "--watch", "--name", "watcher"]
        watch += ["--linger", "3", "--screenshot", str(picture), "--screenshot-step", "30"]
        watch += ["--headless"] if headless else []
        processes.append(subprocess.Popen(watch, stderr=subprocess.DEVNULL, text=True))
        console.print(f"[bold]window[/]     {'drawing without a screen' if headless else 'open'}")
        bots = []
        for name in ("ada", "grace"):
            bot = [command("robotouille-bot"), "planner", "--episode", code, "--url", url]
            bots.append(
                subprocess.Popen(
                    [*bot, "--name", name],
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
        processes += bots
        with console.status("two bots are cooking …"):
            for process in [*bots, processes[1]]:
                process.wait(timeout=MINUTES * 60)
        for bot in bots:
            if bot.returncode:
                sys.exit(f"a bot failed: {bot.stderr.read() if bot.stderr else bot.returncode}")
    except subprocess.TimeoutExpired:
        sys.exit(f"the bots did not finish in {MINUTES} minutes")
    finally:
        for process in reversed(processes):
            stop(process)
    finish(out, recordings, picture)


def finish(out: Path, recordings: Path, picture: Path) -> None:
    """Verify the recording, make the video, and list the files."""
    recording = next(recordings.glob("*.rbt"), None)
    if recording is None:
        sys.exit("the server wrote no recording")
    robotouille = command("robotouille")
    subprocess.run([robotouille, "replay", "info", str(recording)], check=True)
    subprocess.run([robotouille, "replay", "verify", str(recording)], check=True)
    told = subprocess.run(
        [robotouille, "replay", "info", "--json", str(recording)],
        check=True,
        capture_output=True,
        text=True,
    )
    if (json.loads(told.stdout)["outcome"] or {}).get("reason") != "goal":
        sys.exit(f"the bots did not cook the meal; see the recording {recording}")
    film = out / "kitchen.mp4"
    video = [robotouille, "replay", "video", str(recording), str(film), "--speed", "8"]
    with console.status("rendering the video …"):
        subprocess.run([*video, "--size", "960x540"], check=True)
    for what, path in (("recording", recording), ("picture", picture), ("video", film)):
        size = f"{path.stat().st_size:,} bytes"
        console.print(f"[bold]{what:10}[/] {path} ({size})", soft_wrap=True)
    play = f"{os.path.relpath(robotouille)} play multi_agent/01"
    console.print(f"[bold]next[/]       open the video, or play yourself: {play}", soft_wrap=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="multi_agent/01_lettuce_burger")
    parser.add_argument("--out", type=Path, default=Path("out/demo"))
    parser.add_argument("--headless", action="store_true", help="draw without a screen")
    arguments = parser.parse_args()
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    headless = arguments.headless or (sys.platform.startswith("linux") and not screen)
    begun = time.monotonic()
    run(arguments.task, arguments.out, headless)
    console.print(f"done in {time.monotonic() - begun:.0f} s")


if __name__ == "__main__":
    main()
