"""Prove shortest plans of the built-in pack `paper`, and write them next to its module.

    python tools/prove_paper_pack.py

Run it after a change to the tasks or the pack. Plans that are still proven are found again. The
search takes a few minutes, and seconds with the extra `fast`.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import robotouille_evaluation.packs
from robotouille.planning import solve
from robotouille_client.console.progress import progress_bar
from robotouille_evaluation.packs.checking import prove_instances
from robotouille_evaluation.packs.paper import PLANS, build_paper_pack


def main() -> None:
    """Write the proven plans, and print the instances without one."""
    found = build_paper_pack()
    pack = replace(found, instances=tuple(replace(each, plans=()) for each in found.instances))
    with progress_bar("instances") as bar:
        proven = {
            instance.id: [*instance.plans[0].plan]
            for instance in prove_instances(pack, solve, progress=bar)
        }
    # A line for each instance keeps the file readable, and changes to it small.
    lines = [
        f"{json.dumps(each.id)}: {json.dumps(proven[each.id], separators=(',', ':'))}"
        for each in pack.instances
        if each.id in proven
    ]
    path = Path(robotouille_evaluation.packs.__file__).with_name(PLANS)
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    for each in pack.instances:
        if each.id not in proven:
            print(f"not proven: {each.id}")


if __name__ == "__main__":
    main()
