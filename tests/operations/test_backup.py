"""`lab/backup.py` saves consistent backups while episodes run, and restores them."""

from __future__ import annotations

import asyncio
import io
import json
import os
import random
import stat
import subprocess
import sys
import tarfile
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay import read_recording
from robotouille_client import Game, connect
from tests.support.postgresql import PostgreSQL, missing, postgresql
from tests.support.processes import process, started
from tests.support.random_play import write_recordings
from tests.support.scripts import script_module
from tests.support.sources import ROOT

PROGRAM = ROOT / "lab/backup.py"
GAMES = 8


lab = script_module(PROGRAM)


def places(folder: Path, database: str = "none") -> Any:
    return lab.Places(folder / "recordings", folder / "recordings.state", database)


def run(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *map(str, words)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, env={**os.environ, **environment}
    )


def robotouille(*words: object) -> subprocess.CompletedProcess[str]:
    return run("-c", "from robotouille_client.cli.main import main; main()", *words)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folders of a server, without a server."""
    write_recordings(tmp_path / "recordings", 3)
    state = tmp_path / "recordings.state"
    (state / "used-tokens").mkdir(parents=True)
    (state / "keys.json").write_text("{}")
    (state / "used-tokens" / "a.json").write_text("1")
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".tar"
    }


def test_restored_files_equal_saved_files(folder: Path) -> None:
    backup, empty = folder / "b.tar", folder / "empty"
    before = content(folder)
    assert lab.save(backup, places(folder)) == 5
    assert lab.restore(backup, places(empty)) == 5
    assert content(empty) == before
    for path in (backup, *(each for each in empty.rglob("*") if each.is_file())):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_existing_backup_is_not_overwritten(folder: Path) -> None:
    backup = folder / "b.tar"
    backup.write_text("mine")
    with pytest.raises(lab.BackupError, match="already exists"):
        lab.save(backup, places(folder))
    assert backup.read_text() == "mine"
    assert [path.name for path in folder.glob(".*")] == []


def test_backup_is_restored_into_empty_folders_only(folder: Path) -> None:
    backup = folder / "b.tar"
    lab.save(backup, places(folder))
    before = content(folder)
    with pytest.raises(lab.BackupError, match="recordings is not empty"):
        lab.restore(backup, places(folder))
    assert content(folder) == before


def test_huge_manifest_is_not_read(folder: Path) -> None:
    """A sparse file of 1.5 KB claimed gigabytes, which were read into memory."""
    backup = folder / "b.tar"
    with tarfile.open(backup, "w") as tar:
        member = tarfile.TarInfo(lab.MANIFEST)
        member.pax_headers = {
            "GNU.sparse.major": "0", "GNU.sparse.minor": "1", "GNU.sparse.map": "0,0",
            "GNU.sparse.size": str(3 << 30), "GNU.sparse.name": lab.MANIFEST,
        }  # fmt: skip
        tar.addfile(member)
    with pytest.raises(lab.BackupError, match=r"manifest.json is larger than 64 MiB"):
        lab.restore(backup, places(folder / "empty"))


def test_damaged_backup_changes_nothing(folder: Path) -> None:
    backup, empty = folder / "b.tar", folder / "empty"
    before = content(folder)
    lab.save(backup, places(folder))
    whole = backup.read_bytes()
    for seed in range(40):
        rng = random.Random(seed)
        damaged = bytearray(whole)
        if seed % 2:
            damaged = damaged[: rng.randrange(len(damaged))]
        else:
            damaged[rng.randrange(len(damaged) // 2)] ^= 1 << rng.randrange(8)
        backup.write_bytes(bytes(damaged))
        try:
            lab.restore(backup, places(empty))
        except lab.BackupError:
            assert not empty.exists()
        else:  # The damage hit padding between files, or a name or time that is not used.
            assert content(empty) == before
            for path in sorted(empty.rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
            empty.rmdir()


@pytest.mark.parametrize(
    "name",
    [
        "recordings/../../x",
        "elsewhere/x",
        "/x",
        "",
        "recordings",
        "recordings//tmp/x",
        "./state/x",
        "state/./x",
        "state/x\0",
    ],
)
def test_file_outside_the_target_folder_is_refused(tmp_path: Path, name: str) -> None:
    backup = tmp_path / "b.tar"
    digest = "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
    manifest = json.dumps({"files": {name: {"bytes": 1, "sha256": digest}}}).encode()
    with tarfile.open(backup, "w") as tar:
        for each, data in ((name, b"x"), ("manifest.json", manifest)):
            entry = tarfile.TarInfo(each)
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))
    with pytest.raises(lab.BackupError, match=r"is not a path|is damaged"):
        lab.restore(backup, places(tmp_path / "empty"))
    assert not (tmp_path / "empty").exists()


@pytest.mark.parametrize("manifest", ["[]", "1", '{"files": 1}', '{"files": {"state/x": 1}}', ""])
def test_other_archive_is_refused(tmp_path: Path, manifest: str) -> None:
    backup = tmp_path / "b.tar"
    with tarfile.open(backup, "w") as tar:
        for name in ("state/x", "manifest.json"):
            entry = tarfile.TarInfo(name)
            entry.size = len(manifest)
            tar.addfile(entry, io.BytesIO(manifest.encode()))
    with pytest.raises(lab.BackupError, match="not a backup"):
        lab.restore(backup, places(tmp_path / "empty"))


def test_existing_file_or_link_does_not_receive_the_keys(folder: Path) -> None:
    """A readable file or a link already has the name of the temporary file."""
    waiting = folder / ".b.tar.new"
    waiting.symlink_to(folder / "elsewhere")
    lab.save(folder / "b.tar", places(folder))
    assert not (folder / "elsewhere").exists()
    assert [path.name for path in folder.glob(".*")] == [waiting.name]


@pytest.mark.process
def test_missing_folder_and_missing_program_are_reported(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(lab.BackupError, match=r"no folder .*nowhere"):
        lab.save(folder / "b.tar", places(folder / "nowhere"))
    monkeypatch.setenv("PATH", "")
    with pytest.raises(lab.BackupError, match="docker is not installed"):
        lab.save(folder / "b.tar", places(folder, "compose"))
    assert not (folder / "b.tar").exists()


# With real processes


async def play(url: str, saved: asyncio.Event) -> None:
    """Play realtime episodes, some of which end before the backup is saved."""
    async with AsyncExitStack() as stack:
        games: list[Game] = []
        for number in range(GAMES):
            client = await stack.enter_async_context(connect(url, name=f"player{number}"))
            steps = 20 if number % 2 else 100_000
            created = await client.create(
                "synchronous/01", clock="realtime", step_rate=60, max_steps=steps
            )
            games.append(await client.join(created.code))

        async def act(game: Game) -> None:
            rng = random.Random(1)
            while not (game.ended or saved.is_set()):
                await game.next_event()
                if game.has_state and game.my_move and game.actions:
                    await game.act(rng.choice(game.actions))

        await asyncio.gather(*map(act, games))


async def save_meanwhile(url: str, folder: Path, *words: str, **environment: str) -> None:
    saved = asyncio.Event()
    playing = asyncio.create_task(play(url, saved))
    while len(list((folder / "recordings").glob("*.rbt"))) < 2:
        assert not playing.done() or playing.result() is None
        await asyncio.sleep(0.05)
    given = ["--recordings", folder / "recordings", "--state", folder / "recordings.state"]
    done = await asyncio.to_thread(
        run, PROGRAM, "save", folder / "b.tar", *given, *words, **environment
    )
    assert done.returncode == 0, done.stderr
    saved.set()
    await playing


@pytest.mark.process
@pytest.mark.slow
def test_episodes_saved_while_running_continue_after_restore(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    with process(old / "recordings", "--task", "synchronous/01") as (_, url, _code):
        asyncio.run(save_meanwhile(url, old, "--database", "none"))
    given = ["--recordings", new / "recordings", "--state", new / "recordings.state"]
    done = run(PROGRAM, "restore", old / "b.tar", *given, "--database", "none")
    assert done.returncode == 0, done.stderr

    files = sorted((new / "recordings").iterdir())
    unfinished = [file for file in files if file.suffix == ".part"]
    # Includes the episode that the server opens at startup.
    assert len(unfinished) > GAMES // 2
    verified = robotouille("replay", "verify", *files)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    for file in files:
        later = next((old / "recordings").glob(f"{file.name.removesuffix('.part')}*"))
        received, known = read_recording(file).steps, read_recording(later).steps
        assert list(received) == known[: len(received)]

    keys = "recordings.state/keys.json"
    assert (new / keys).read_bytes() == (old / keys).read_bytes()
    with started(new / "recordings", "--recovery-seconds", "60") as (_, greeting):
        assert f"continuing {len(unfinished)} earlier episodes" in greeting


SUBSTITUTE = """#!{python}
import os, sys
assert sys.argv[1:5] == ["compose", "exec", "-T", "postgres"], sys.argv
program, *words = sys.argv[5:]
at = words.index("--username")
assert words[at + 1] == "robotouille"
words[at + 1] = "postgres"
os.execvp(program, [program, "--host", "{host}", *words])
"""
"""Replacement for `docker` that runs the database container's commands locally."""


def catalogue(server: PostgreSQL, name: str) -> str:
    return server.url.replace("/postgres?", f"/{name}?")


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_restored_catalogue_equals_a_new_index(tmp_path: Path) -> None:
    pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
    old, new, programs = tmp_path / "old", tmp_path / "new", tmp_path / "programs"
    write_recordings(old / "recordings", 5)
    (old / "recordings.state").mkdir()
    programs.mkdir()
    with postgresql() as server:
        docker = programs / "docker"
        docker.write_text(
            SUBSTITUTE.format(python=sys.executable, host=server.url.partition("=")[2])
        )
        docker.chmod(0o700)
        environment = {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
        psql(server, "CREATE DATABASE robotouille")
        database = catalogue(server, "robotouille")
        assert (
            robotouille("data", "index", old / "recordings", "--database", database).returncode == 0
        )
        before = rows(server)
        given = ["--recordings", old / "recordings", "--state", old / "recordings.state"]
        done = run(PROGRAM, "save", tmp_path / "b.tar", *given, **environment)
        assert done.returncode == 0, done.stderr

        psql(server, "DROP DATABASE robotouille")
        psql(server, "CREATE DATABASE robotouille")
        given = ["--recordings", new / "recordings", "--state", new / "recordings.state"]
        done = run(PROGRAM, "restore", tmp_path / "b.tar", *given, **environment)
        assert done.returncode == 0, done.stderr
        assert rows(server) == before
        again = robotouille("data", "index", new / "recordings", "--database", database)
        assert again.stdout == "indexed 5, unchanged 0, removed 0\n"
        assert rows(server) == before


def psql(server: PostgreSQL, command: str, name: str = "postgres") -> str:
    words = ["psql", "--no-psqlrc", "--tuples-only", "--no-align", "--command", command]
    done = subprocess.run(
        [*words, catalogue(server, name)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


TABLES = ("episodes", "seats", "steps", "events", "labels", "measures")


def rows(server: PostgreSQL) -> dict[str, str]:
    return {
        name: psql(server, f"SELECT t::text FROM {name} t ORDER BY 1", "robotouille")
        for name in TABLES
    }
