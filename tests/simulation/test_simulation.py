"""Short simulations, with and without strangers."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.programs.simulation.day import simulate_day
from tests.programs.simulation.simulation import Report, run_seed
from tests.programs.simulation.stranger import CODE, FLOODS
from tests.support.fuzzing.wire import Closed, Wire
from tests.support.samples import quick_sample
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

ROOT = Path(__file__).resolve().parents[2]
FIRST, LAST = map(int, os.environ.get("SIMULATION_SEEDS", "0:150").split(":"))
BLOCK = 3


def failure_text(report: Report) -> str:
    lines = [f"reproduce: python -m tests.programs.simulation --seed {report.seed} --trace"]
    return "\n".join(lines + report.faults)


@pytest.mark.parametrize("start", quick_sample(range(FIRST, LAST, BLOCK), 1, nightly=7))
def test_episodes_survive_all_faults(start: int) -> None:
    reports = [run_seed(seed) for seed in range(start, min(start + BLOCK, LAST))]
    failed = [failure_text(report) for report in reports if not report.ok]
    assert not failed, "\n\n".join(failed)
    compared = sum(report.counts.get("states", 0) for report in reports)
    broken = sum(times for report in reports for what, times in report.counts.items())
    # The quietest blocks of three seeds compare about thirty states.
    assert compared > 15 and broken > compared, "the simulation has checked too little"


def test_give_way_to_others_works_without_a_socket() -> None:
    report = run_seed(198_195_520)
    assert report.ok, failure_text(report)


@pytest.mark.process
@pytest.mark.slow
def test_seed_gives_the_same_course_in_every_process() -> None:
    """The course must not depend on hashes, addresses or earlier runs."""
    program = (
        "from tests.programs.simulation.simulation import run_seed\n"
        "print(*(run_seed(seed).digest for seed in {seeds}))"
    )

    def digests(seeds: str, hash_seed: str) -> list[str]:
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        done = subprocess.run(
            [sys.executable, "-c", program.format(seeds=seeds)],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split()

    forwards = digests("range(2)", "0")
    backwards = digests("reversed(range(2))", "4711")
    assert forwards == backwards[::-1]
    assert len(set(forwards)) == 2


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("minutes", [3, 15])
def test_long_running_server_does_not_diverge(minutes: int) -> None:
    """Simulate a few minutes; `--day` simulates 24 hours and also checks the memory."""
    looks: list[str] = []
    report = simulate_day(1, minutes / 60, looks.append, rooms=2)
    assert report.ok, failure_text(report)
    assert len(looks) >= 1.5 * minutes
    assert report.counts["states"] > 166 * minutes


UNANSWERED = ("pings", "pongs", "parts")
"""Floods that the server ends without a message."""


@pytest.mark.parametrize("name", quick_sample(sorted(FLOODS), 4))
def test_flood_is_ended_and_the_episode_continues(tmp_path: Path, name: str) -> None:
    async def main() -> None:
        async with serving(tmp_path, hello_seconds=5) as server, raw(server) as ada:
            order = {"type": "create", "task": "synchronous/01", "clock": "realtime"}
            created = await ada.ask({**order, "step_rate": 10}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            await ada.expect("snapshot")
            before = (await ada.expect("delta"))["step"]
            wire = await Wire.open(server.port)
            assert await wire.upgrade(text=True) == 101
            said = []
            try:
                await wire.write(FLOODS[name].replace(CODE.encode(), created["code"].encode()))
                async with asyncio.timeout(10):
                    async for answer in wire.messages():
                        said.append(answer)
                pytest.fail("the messages ended without the connection")
            except Closed as closed:
                polite = closed.code == 1008
            assert polite == (name not in UNANSWERED)
            if polite:
                code = "auth/silent" if name == "silence" else "rate/limited"
                assert (said[-1]["type"], said[-1]["code"]) == ("bye", code)
            wire.cut()
            while (await ada.expect("delta"))["step"] < before + 20:
                pass

    run(main())
