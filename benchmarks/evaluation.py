"""Measure the evaluation: steps to go, episodes with all metrics, the report and the import.

python -m benchmarks.evaluation --quick
ROBOTOUILLE_COMPILE=0 python -m benchmarks.evaluation --only steps

Report and import need the extra `bench`. The import also needs a checkout of the published
repository next to the project and is skipped without one.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

from tests.support.episode_rows import made_up_rows
from tests.support.published import CHECKOUT

from robotouille import GroundAction, State, World, load_task
from robotouille.domain.task import Timing
from robotouille.planning import StepsToGo
from robotouille.planning.errands import PlanTrace, errands
from robotouille.planning.kitchen.kernels import COMPILED
from robotouille.planning.plan import Plan
from robotouille.planning.plan_repair import PlanRepair
from robotouille_evaluation.metrics.measuring import default_limits
from robotouille_evaluation.metrics.rows import PackId, ResultRow
from robotouille_evaluation.models import Model
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.store import write_pack
from robotouille_evaluation.runs import AgentSpec, EpisodeJob, JobOptions, RunFolder, plan_jobs
from robotouille_evaluation.runs.folder import RunPlan
from robotouille_evaluation.runs.workers import Workers, run_jobs

MEDIAN, P99 = 0.020, 0.200
"""Target seconds to compute the steps to go of a state."""
EPISODES, EPISODE_SECONDS = 1_000, 60
SEEDS = 10
"""Number of episodes of each instance."""
ROWS, REPORT_SECONDS = 10_000, 60
IMPORT_SECONDS = 30
PROCESSES = 2
STEPS = 40


def verdict(seconds: float, most: float) -> str:
    """Compare a time with its target, in words."""
    return f"(under {most:g} s: {'met' if seconds < most else 'MISSED'})"


# Steps to go


def course(world: World, plan: Plan, start: State, wild: int) -> Iterator[State]:
    """Yield the states of an episode that mixes random steps with steps to the goal.

    Args:
        world: World to play in.
        plan: Plan that reaches the goal.
        start: First state of the plan, in this world or in one with another timing.
        wild: Number of random steps among every three.
    """
    dice, kit = random.Random(wild), PlanRepair(world)
    rest, state = errands(PlanTrace.of(plan, start)), world.initial
    for number in range(STEPS):
        yield state
        if state.goal_reached:
            return
        found = kit.repair(rest, state) if number % 3 >= wild else None
        joint = found.joints[0] if found is not None else tuple(_random(state, dice))
        rest = rest if found is None else errands(found)
        state = state.step(joint).state


def _random(state: State, dice: random.Random) -> Iterator[GroundAction]:
    for player in state.world.players:
        valid = state.actions(player)
        if valid:
            yield dice.choice(valid)


def steps_to_go(pack: Pack, timing: Timing, *, teams: bool, tasks: int) -> str:
    """Measure steps to go on default layouts in random and in mostly good play."""
    times, exact = [], 0
    chosen = [i for i in pack.instances if i.kind == "default" and (i.seats > 1) == teams]
    for instance in chosen[:: max(1, len(chosen) // tasks)]:
        plain = World(load_task(instance.task, seats=instance.seats))
        world = World(load_task(instance.task, seats=instance.seats, timing=timing))
        plan = pack.plan(instance, plain)
        for wild in (3, 1):
            distance, before = StepsToGo(world), None
            if teams:
                distance.learn(plain.initial, plan)
            for state in course(world, plan, plain.initial, wild):
                begun = time.process_time()
                left = distance(state, default_limits(world), after=before)
                times.append(time.process_time() - begun)
                before, exact = state, exact + left.exact
    middle, high = statistics.median(times), statistics.quantiles(times, n=100)[98]
    return (
        f"{timing.value:<10} {'teams' if teams else 'one player':<11}"
        f" median {middle * 1e3:5.1f} ms {verdict(middle, MEDIAN)}"
        f"  p99 {high * 1e3:4.0f} ms {verdict(high, P99)}"
        f"  exact {exact / len(times):.0%} of {len(times)}"
    )


def all_steps_to_go(pack: Pack, tasks: int) -> None:
    """Print a line for each timing, for one player and for teams."""
    print("Steps to go of a state, processor time" + ("" if COMPILED else ", plain Python"))
    for name in ("synchronous/01", "multi_agent/01"):  # Load the kernels from disk.
        warm = World(name)
        StepsToGo(warm)(warm.initial, default_limits(warm))
    for timing in Timing:
        for teams in (False, True):
            print("  " + steps_to_go(pack, timing, teams=teams, tasks=tasks), flush=True)


# Episodes, report, import


def random_episodes(pack: Pack, count: int) -> float:
    """Return the seconds that `count` episodes of the random agent take with all metrics."""
    chosen = [
        i for i in pack.instances
        if pack.task(i.task).dataset == "asynchronous" and i.kind != "default"
    ]  # fmt: skip
    agent = AgentSpec(name="random", kind="random")
    planned = tuple(islice(plan_jobs(pack, [agent], chosen, JobOptions(seeds=range(SEEDS))), count))

    async def no_model(job: EpisodeJob) -> Model:
        raise AssertionError(f"{job.id} needs a model")

    with tempfile.TemporaryDirectory() as name:
        write_pack(pack, Path(name) / "pack")
        plan = RunPlan(
            name="bench",
            pack=PackId(name=pack.name, version=pack.version, digest=pack.digest),
            pack_folder=str(Path(name) / "pack"),
            jobs=planned,
            software=version("robotouille"),
            steps_to_go=True,
        )
        folder = RunFolder.create(Path(name) / "run", plan)
        begun = time.perf_counter()
        workers = Workers(processes=PROCESSES)
        asyncio.run(run_jobs(folder, pack, planned, workers, no_model, lambda _, row: check(row)))
        return time.perf_counter() - begun


def processor() -> float:
    """Return the processor seconds used by this process and its children."""
    return sum(os.times()[:4])


def check(row: ResultRow) -> None:
    """Fail if an episode ended with an error, because its time would be too short."""
    if row.error:
        raise AssertionError(row.error)


def report(pack: Pack, count: int) -> float:
    """Return the seconds for a report of `count` synthetic rows over all tasks."""
    from robotouille_evaluation.report import write_report

    places = [(pack.task(t.name).dataset, t.name) for t in pack.tasks]
    rows: list[ResultRow] = []
    seed = 0
    while len(rows) < count:
        for row in made_up_rows(seed=seed):
            fitting = [t for d, t in places if d == row.dataset]
            task = fitting[(seed + len(rows)) % len(fitting)]
            rows.append(row.model_copy(update={"task": task, "seed": seed}))
        seed += 1
    with tempfile.TemporaryDirectory() as name:
        begun = time.perf_counter()
        write_report(rows[:count], Path(name))
        return time.perf_counter() - begun


def import_published(seeds: int | None) -> float:
    """Return the seconds to import a checkout, with generation of all instances."""
    from robotouille_evaluation.packs.published_checkout import SEEDS, read_checkout

    begun = time.perf_counter()
    found = read_checkout(CHECKOUT, seeds=SEEDS[:seeds])
    with tempfile.TemporaryDirectory() as name:
        write_pack(found.pack, Path(name))
        return time.perf_counter() - begun


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all measurements, or the one named by `--only`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="measure a tenth of each amount")
    parser.add_argument("--only", choices=("steps", "episodes", "report", "import"))
    options = parser.parse_args(arguments)
    share = 10 if options.quick else 1
    wanted = [options.only] if options.only else ["steps", "episodes", "report", "import"]
    pack = build_own_pack()
    if "steps" in wanted:
        all_steps_to_go(pack, max(2, 20 // share))
    if "episodes" in wanted:
        count, used = EPISODES // share, processor()
        seconds = random_episodes(pack, count)
        used = processor() - used
        each = f"{used / count * 1e3:.0f} ms processor time each, {PROCESSES} processes"
        print(f"{count:,} random episodes with all metrics: {seconds:.0f} s, {each} "
              f"{verdict(seconds, EPISODE_SECONDS / share)}", flush=True)  # fmt: skip
    if "report" in wanted and find_spec("matplotlib") is not None:
        used = processor()
        seconds = report(pack, ROWS // share)
        print(f"Report of {ROWS // share:,} episodes: {seconds:.0f} s, "
              f"{processor() - used:.0f} s processor time "
              f"{verdict(seconds, REPORT_SECONDS)}", flush=True)  # fmt: skip
    if "import" in wanted:
        if not CHECKOUT.is_dir():
            print("Import of the published pack: skipped; needs its checkout next to the project")
        else:
            seconds = import_published(1 if options.quick else None)
            print(f"Import of the published pack: {seconds:.0f} s "
                  f"{verdict(seconds, IMPORT_SECONDS)}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
