"""How fast recordings become tables, a page is made of them, and a label is found among 100,000
episodes.

python -m benchmarks.catalogue --recordings 10000
python -m benchmarks.catalogue --database postgresql://postgres@/postgres?host=/run/postgresql

Needs the extra `data`. A database that is named is emptied of these recordings afterwards.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from tests.support.random_play import random_stream

from robotouille.replay.container import compress, frame_ends, frame_value, pack_frame

RECORDINGS, STEPS, SECONDS = 1_000, 200, 60.0
COURSES = 20
LABELLED, ASKED, LABEL_SECONDS = 100_000, 21, 0.050
JOBS = 2


def write_copies(folder: Path, count: int) -> None:
    """Recordings of a few courses, each under an id of its own."""
    streams = [random_stream(seed, steps=STEPS) for seed in range(COURSES)]
    for number in range(count):
        stream = streams[number % COURSES]
        end = next(frame_ends(stream))
        pair = f"p{number // 6}"
        labels = {"condition": f"c{number // 6 % 2}", "pair": pair, "round": str(number % 3 + 1)}
        head = {**frame_value(stream, 5), "episode": f"copy{number}", "labels": labels}
        content = stream[:5] + pack_frame(head) + stream[end:]
        (folder / f"copy{number}.rbt").write_bytes(compress(content))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=RECORDINGS)
    parser.add_argument("--database")
    parser.add_argument("--jobs", type=int, default=JOBS)
    options = parser.parse_args(arguments)
    if not find_spec("sqlalchemy"):
        print("the catalogue is left out: it needs the extra `data`")
        return
    with tempfile.TemporaryDirectory() as name:
        measure(Path(name), options.database, options.recordings, options.jobs)


def measure(folder: Path, database: str | None, recordings: int, jobs: int) -> None:
    """Index, ask, and forget."""
    import sqlalchemy as sa

    from robotouille_data.database import database_url, insert, writing
    from robotouille_data.indexing import index
    from robotouille_data.schema import LABELS

    write_copies(folder, recordings)
    url = database_url(database, folder)
    began = time.perf_counter()
    found = index(url, [folder], jobs=jobs)
    seconds = time.perf_counter() - began
    steps = found.indexed * STEPS
    print(f"{found.indexed} recordings of {STEPS} steps, {jobs} processes: {seconds:.1f} s")
    rate = steps / seconds
    print(f"{rate:,.0f} steps/s; 2,000,000 in {2_000_000 / rate:.0f} s (aim: {SECONDS:.0f} s)")
    began = time.perf_counter()
    index(url, [folder], jobs=jobs)
    print(f"again, with nothing new: {time.perf_counter() - began:.2f} s")
    if find_spec("matplotlib"):
        from robotouille_data.answers.report.write import write_report

        began = time.perf_counter()
        count = write_report(url, folder / "report.html")
        size = (folder / "report.html").stat().st_size
        print(f"a report of {count:,} episodes, {size / 1e6:.1f} MB: "
              f"{time.perf_counter() - began:.1f} s")  # fmt: skip
    with writing(url).begin() as connection:
        rows = [
            (number, name, value)
            for number in range(LABELLED)
            for name, value in (("condition", f"c{number % 500}"), ("pair", f"p{number // 2}"))
        ]
        insert(connection, LABELS, rows)
        connection.exec_driver_sql("ANALYZE labels")
    query = "SELECT episode_id FROM labels WHERE name = 'condition' AND value = 'c7'"
    times = []
    with writing(url).connect() as connection:
        for _ in range(ASKED):
            began = time.perf_counter()
            assert len(connection.exec_driver_sql(query).all()) == LABELLED // 500
            times.append(time.perf_counter() - began)
    print(
        f"a label among {LABELLED:,} episodes: {statistics.median(times) * 1000:.2f} ms "
        f"(aim: {LABEL_SECONDS * 1000:.0f} ms)"
    )
    with writing(url).begin() as connection:
        connection.execute(sa.delete(LABELS).where(LABELS.c.episode_id < LABELLED))
    for path in folder.glob("*.rbt"):
        path.unlink()
    index(url, [folder], jobs=jobs)


if __name__ == "__main__":
    main()
