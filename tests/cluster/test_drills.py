"""Short drills of a cluster of real processes."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from tests.programs.cluster_drill.drills import DRILLS, THROUGHPUT, run_short
from tests.programs.cluster_drill.stage import Plan
from tests.programs.drill.report import aligned
from tests.support.nats import missing


def few(plan: Plan) -> Plan:
    return replace(plan, games=4, away=4.0, rounds=1, processes=1, seed=7, steps=(25, 60))


# One test for all drills: they share a cluster, because starting one takes longer than a drill.
@pytest.mark.process
@pytest.mark.nightly
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_episodes_survive_failures_of_nodes_and_of_nats(tmp_path: Path) -> None:
    results = asyncio.run(run_short([*DRILLS, THROUGHPUT], tmp_path, print, few))
    assert list(results) == [*DRILLS, "comparison", THROUGHPUT]
    for name, result in results.items():
        assert result.ok, f"{name}\n{aligned(result.rows, result.faults)}"
        assert result.rows
    verdict = results["comparison"].verdict
    assert verdict.games >= len(DRILLS)
    assert verdict.verified >= verdict.games
    assert set(verdict.outcomes) <= {"goal", "step_limit"}
    assert max(verdict.restarts) >= 1
    assert verdict.actions > 50
