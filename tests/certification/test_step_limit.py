"""Step limits for people: six times the certified plan, and at least three minutes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotouille import World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille.certification.step_limit import people_step_limit, plan_beside, retimed_length
from robotouille.files.reading import MAX_FILE_BYTES

NAMES = ["synchronous/01", "asynchronous/07", "multi_agent/01@2", "multi_agent/10@3"]


@pytest.mark.parametrize("name", NAMES)
def test_benchmark_limit_is_six_times_the_certified_length(name: str) -> None:
    task = load_task(name)
    length = load_certificate(task).length
    assert length is not None
    assert retimed_length(task) == length
    assert people_step_limit(task, None) == 6 * length


@pytest.mark.parametrize("name", NAMES)
def test_timing_for_people_counts_walks_and_delays(name: str) -> None:
    longer, shorter = retimed_length(load_task(name, timing="people")), load_certificate(name)
    assert longer is not None
    assert shorter.length is not None
    assert shorter.length < longer < 20 * shorter.length


def test_real_time_games_last_three_minutes() -> None:
    task = load_task("multi_agent/01", timing="people")
    length = retimed_length(task)
    assert length is not None
    assert people_step_limit(task, 5.0) == 900
    assert people_step_limit(task, 0.5) == 6 * length


def test_no_limit_without_certificate(tmp_path: Path) -> None:
    shipped = load_task("synchronous/01", timing="people")
    problem = tmp_path / "mine.json"
    problem.write_text(Path(shipped.source).read_text("utf-8"), "utf-8")
    assert people_step_limit(load_task(str(problem), timing="people"), 5.0) is None
    fields = json.loads(load_certificate("synchronous/01").model_dump_json())
    (tmp_path / "mine.certificate.json").write_text(json.dumps(fields | {"instance": "0" * 32}))
    assert people_step_limit(load_task(str(problem), timing="people", seed=0), 5.0) is None


def test_plan_file_that_is_too_long_is_not_read(tmp_path: Path) -> None:
    """A sparse file of 1 GB next to a problem took 13 GB of memory."""
    world, problem = World("synchronous/01"), tmp_path / "mine.json"
    source = Path(world.task.source)
    problem.write_bytes(source.read_bytes())
    plan = problem.with_suffix(".plan")
    plan.write_bytes(source.with_suffix(".plan").read_bytes())
    assert plan_beside(World(str(problem))) == plan_beside(world)
    with plan.open("ab") as file:
        file.write(b"# " + bytes(MAX_FILE_BYTES))
    assert plan_beside(World(str(problem))) is None
