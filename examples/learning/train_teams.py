"""Train IPPO and MAPPO on three tasks and a shift, and draw all curves into one picture.

    python examples/learning/train_teams.py OUT

OUT is a folder for weights, tables and the picture. It needs robotouille-jax[train].
"""

from __future__ import annotations

import sys
from pathlib import Path

from robotouille_jax.learning.__main__ import main
from robotouille_jax.learning.curves import draw

TASKS = {
    "training/03@2": [],
    "multi_agent/01@2": [],
    "multi_agent/04@2": [],
    "shifts/01_sandwich_bar@2": ["--updates", "161", "--entropy", "0.02"],
}
"""The shortest team tasks, and the easiest shift, which has ten times as many actions."""


def train(out: Path) -> None:
    for task, options in TASKS.items():
        main([task, "--starts", "plan", "--out", str(out), "--no-picture", *options])
    draw(out / "teams.png", sorted(out.glob("*_curves.csv")))


if __name__ == "__main__":
    train(Path(sys.argv[1]))
