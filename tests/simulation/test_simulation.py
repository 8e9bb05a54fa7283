"""Games that survive everything: some hundred seeds; `SIMULATION_SEEDS=FROM:TO` runs others."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.programs.simulation.day import simulate_day
from tests.programs.simulation.simulation import Report, run_seed
from tests.support.samples import first_quickly

ROOT = Path(__file__).resolve().parents[2]
FIRST, LAST = map(int, os.environ.get("SIMULATION_SEEDS", "0:150").split(":"))
BLOCK = 5


def told(report: Report) -> str:
    lines = [f"reproduce: python -m tests.programs.simulation --seed {report.seed} --trace"]
    return "\n".join(lines + report.faults)


@pytest.mark.parametrize("start", first_quickly(range(FIRST, LAST, BLOCK), 1, nightly=4))
def test_games_survive_whatever_goes_wrong(start: int) -> None:
    reports = [run_seed(seed) for seed in range(start, min(start + BLOCK, LAST))]
    failed = [told(report) for report in reports if not report.ok]
    assert not failed, "\n\n".join(failed)
    compared = sum(report.counts.get("states", 0) for report in reports)
    broken = sum(times for report in reports for what, times in report.counts.items())
    assert compared > 100 and broken > compared, "the simulation has checked hardly anything"


@pytest.mark.process
@pytest.mark.slow
def test_a_seed_gives_the_same_course_in_every_process() -> None:
    """Whatever hashes and addresses are, and whatever ran before."""
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
def test_a_server_that_runs_for_long_does_not_diverge(minutes: int) -> None:
    """Some simulated minutes; `--day` runs 24 hours, and judges memory as well."""
    looks: list[str] = []
    report = simulate_day(1, minutes / 60, looks.append, rooms=2)
    assert report.ok, told(report)
    assert len(looks) >= 1.5 * minutes
    assert report.counts["states"] > 166 * minutes
