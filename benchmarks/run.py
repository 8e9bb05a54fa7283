"""Run all benchmarks (`make bench`)."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.programs.floods.__main__ import main as run_floods

from benchmarks import (
    batch,
    catalogue,
    core,
    endurance,
    environments,
    evaluation,
    exports,
    idle,
    joint,
    model_calls,
    mqtt,
    page,
    parts,
    peers,
    planning,
    server,
    startup,
    substitutes,
    viewer,
    window,
)

if __name__ == "__main__":
    core.main()
    joint.main()
    environments.main()
    batch.main([])
    planning.main()
    evaluation.main([])
    catalogue.main([])
    exports.main([])
    viewer.main([])
    window.main([])
    page.main([])
    idle.main([])
    startup.main()
    endurance.main([])
    parts.main([])
    server.main()
    peers.main([])
    mqtt.main([])
    model_calls.main([])
    substitutes.main(["--rooms", "100", "--seconds", "10"])
    run_floods(["--runs", "3", "--seconds", "2"])
