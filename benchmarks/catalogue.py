"""Measure indexing, the report, and the search for a label among 100,000 episodes.

python -m benchmarks.catalogue --recordings 10000
python -m benchmarks.catalogue --database postgresql://postgres@/postgres?host=/run/postgresql

Needs the extra `data`. Afterwards the benchmark removes its recordings from the database.
"""

from __future__ import annotations

import argparse
import random
import statistics
import tempfile
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from robotouille import World, load_task
from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.replay.compression import compress
from robotouille.replay.container import frame_ends, frame_value, pack_frame
from robotouille.replay.recorder import Recorder, header

RECORDINGS, STEPS, SECONDS = 1_000, 200, 60.0
RATE = 5.0
COURSES = 20
LABELLED, ASKED, LABEL_SECONDS = 100_000, 21, 0.050
JOBS = 2


def course(seed: int) -> bytes:
    """Return a recording of two people who act in most steps and chat now and then.

    Some of their requests are rejected, and they do not reach the goal in `STEPS` steps.
    """
    rng = random.Random(seed)
    world = World(load_task("multi_agent/09@2", timing="people"))
    rules = Rules(clock=Clock.REALTIME, step_rate=RATE, max_steps=STEPS)
    episode, recorder = Episode(world, rules), Recorder(world)
    head = header(
        world.task, rules, episode=f"e{seed}", seed=seed, created="2026-01-01T00:00:00+00:00"
    )
    stream = recorder.begin(head)
    for player in world.players:
        episode.join(player, f"name of {player}", "human", 0.0)
    now, number = 0.0, 0
    while not episode.ended:
        now, number = now + 1 / RATE, number + 1
        for player in world.players:
            wish = rng.random()
            if wish < 0.05:
                impossible = rng.choice(world.ground_actions(player))
                episode.submit(player, ActionRequest(number, impossible), now - 0.1)
            elif wish < 0.7 and (valid := episode.state.actions(player)):
                episode.submit(player, ActionRequest(number, rng.choice(valid)), now - 0.1)
            elif wish > 0.98:
                episode.say("name", player, "the onion is burning", now - 0.1)
        episode.tick(now)
        stream += recorder.record(episode.events())
    return stream


def write_copies(folder: Path, count: int) -> None:
    """Write `count` recordings of a few courses, each with its own id."""
    streams = [course(seed) for seed in range(COURSES)]
    for number in range(count):
        stream = streams[number % COURSES]
        end = next(frame_ends(stream))
        pair = f"p{number // 6}"
        labels = {"condition": f"c{number // 6 % 2}", "pair": pair, "round": str(number % 3 + 1)}
        head = {**frame_value(stream, 5), "episode": f"copy{number}", "labels": labels}
        content = stream[:5] + pack_frame(head) + stream[end:]
        (folder / f"copy{number}.rbt").write_bytes(compress(content))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    parser.add_argument("--database")
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args(arguments)
    if not find_spec("sqlalchemy"):
        print("catalogue: skipped; needs the extra `data`")
        return
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), options.database, options.recordings, options.jobs)


def measure(folder: Path, database: str | None, recordings: int, jobs: int) -> None:
    """Index recordings, query them, and remove them."""
    import sqlalchemy as sa

    from robotouille_data.database import database_url, insert, writing_engine
    from robotouille_data.indexing import index
    from robotouille_data.schema import LABELS

    write_copies(folder, recordings)
    url = database_url(database, folder)
    began = time.perf_counter()
    found = index(url, [folder], jobs=jobs)
    seconds = time.perf_counter() - began
    with writing_engine(url).connect() as connection:
        rows = connection.exec_driver_sql("SELECT count(*) FROM steps WHERE seat = 0").scalar_one()
        events = connection.exec_driver_sql("SELECT count(*) FROM events").scalar_one()
    steps = int(rows)
    print(f"{found.indexed} recordings, {steps:,} steps of two seats, {events:,} events, "
          f"{jobs} processes: {seconds:.1f} s")  # fmt: skip
    rate = steps / seconds
    print(f"{rate:,.0f} steps/s; 2,000,000 in {2_000_000 / rate:.0f} s (target: {SECONDS:.0f} s)")
    began = time.perf_counter()
    index(url, [folder], jobs=jobs)
    print(f"indexing again without changes: {time.perf_counter() - began:.2f} s")
    if find_spec("matplotlib"):
        from robotouille_data.report.page import write_report

        began = time.perf_counter()
        count = write_report(url, folder / "report.html")
        size = (folder / "report.html").stat().st_size
        print(f"report of {count:,} episodes, {size / 1e6:.1f} MB: "
              f"{time.perf_counter() - began:.1f} s")  # fmt: skip
    with writing_engine(url).begin() as connection:
        rows = [
            (number, name, value)
            for number in range(LABELLED)
            for name, value in (("condition", f"c{number % 500}"), ("pair", f"p{number // 2}"))
        ]
        insert(connection, LABELS, rows)
        connection.exec_driver_sql("ANALYZE labels")
    query = "SELECT episode_id FROM labels WHERE name = 'condition' AND value = 'c7'"
    times = []
    with writing_engine(url).connect() as connection:
        for _ in range(ASKED):
            began = time.perf_counter()
            assert len(connection.exec_driver_sql(query).all()) == LABELLED // 500
            times.append(time.perf_counter() - began)
    print(
        f"search for a label among {LABELLED:,} episodes: {statistics.median(times) * 1000:.2f} ms "
        f"(target: {LABEL_SECONDS * 1000:.0f} ms)"
    )
    with writing_engine(url).begin() as connection:
        connection.execute(sa.delete(LABELS).where(LABELS.c.episode_id < LABELLED))
    for path in folder.glob("*.rbt"):
        path.unlink()
    index(url, [folder], jobs=jobs)


if __name__ == "__main__":
    main()
