"""`make bench`: every figure, ratios in one run."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import core, planning, server

if __name__ == "__main__":
    core.main()
    planning.main()
    server.main()
