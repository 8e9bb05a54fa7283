"""Short drills of clusters of real processes."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.programs.cluster_drill.drills import DRILLS, SIDE_BY_SIDE, run_short
from tests.programs.drill.report import aligned
from tests.support.nats import missing


# One test for all drills: they share two clusters, because starting one takes longer than a drill.
@pytest.mark.process
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_episodes_survive_failures_of_nodes_and_of_nats(tmp_path: Path) -> None:
    results = asyncio.run(run_short(DRILLS, tmp_path, print))
    comparisons = [f"{', '.join(group)}: comparison" for group in SIDE_BY_SIDE]
    assert {*results} == {*DRILLS, *comparisons}
    for name, result in results.items():
        assert result.ok, f"{name}\n{aligned(result.rows, result.faults)}"
        assert result.rows
    verdicts = [results[name].verdict for name in comparisons]
    assert max(max(verdict.restarts) for verdict in verdicts) >= 1
    for verdict in verdicts:
        assert verdict.verified >= verdict.games > 0
        assert set(verdict.outcomes) <= {"goal", "step_limit"}
        assert verdict.actions > 50
