"""`lab/make_secrets.py`: what it makes nobody else can read, and what is there stays."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.compose import compose
from tests.support.scripts import script_module
from tests.support.sources import ROOT

USER = "1000:1000" if os.geteuid() == 0 else f"{os.geteuid()}:{os.getegid()}"
SECRETS = "lab/secrets"


lab = script_module(ROOT / "lab/make_secrets.py")


def content(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_all_that_compose_asks_for_is_made_for_the_user_alone(tmp_path: Path) -> None:
    made = list(lab.make(tmp_path, USER))
    files = {
        secret["file"] for secret in compose({"LAB_SECRETS": "./lab/secrets"})["secrets"].values()
    }
    assert {name for name in made if name != ".env"} >= {file.removeprefix("./") for file in files}
    for path in (tmp_path / ".env", *tmp_path.glob("lab/data/*"), *tmp_path.glob("lab/secrets/*")):
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path


def test_folders_that_are_mounted_are_made(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    variables = dict(line.split("=", 1) for line in (tmp_path / ".env").read_text().splitlines())
    for service in compose(variables)["services"].values():
        for volume in service.get("volumes", []):
            source = volume.partition(":")[0]
            assert (
                (tmp_path / source).is_dir()
                or (ROOT / source).is_file()
                or not (source.startswith("./lab/data"))
            ), source
        assert service["user"] == USER


def test_every_variable_of_the_file_is_one_that_compose_fills_in(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    text = (ROOT / "docker-compose.yml").read_text()
    for line in (tmp_path / ".env").read_text().splitlines():
        name = line.partition("=")[0]
        assert f"${{{name}:-" in text or name == "COMPOSE_PROFILES"


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    before = content(tmp_path)
    assert list(lab.make(tmp_path, USER)) == []
    assert content(tmp_path) == before


def test_no_two_are_alike(tmp_path: Path) -> None:
    for name in ("one", "two"):
        list(lab.make(tmp_path / name, USER))
    found = [
        (tmp_path / name / SECRETS / file).read_text()
        for name in ("one", "two")
        for file in lab.PASSWORDS
    ]
    assert len(set(found)) == len(found)
    assert all(len(password) == 48 for password in found)


def test_one_that_others_can_read_is_told(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "postgres").chmod(0o644)
    with pytest.raises(
        lab.LabError, match=r"postgres: others may use it \(mode 0644\); run `chmod"
    ):
        list(lab.make(tmp_path, USER))


def test_an_empty_one_is_told(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "pgpass").write_text("")
    with pytest.raises(lab.LabError, match="pgpass is empty; delete it"):
        list(lab.make(tmp_path, USER))


def test_a_password_that_is_gone_while_others_know_it_is_told(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "postgres").unlink()
    with pytest.raises(lab.LabError, match="pgpass was made from postgres, which is gone: delete"):
        list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "pgpass").unlink()
    assert list(lab.make(tmp_path, USER)) == ["lab/secrets/postgres", "lab/secrets/pgpass"]


@pytest.mark.process
@pytest.mark.skipif(os.geteuid() != 0, reason="only root has to say for whom")
def test_root_says_for_whom(tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    shutil.copy(ROOT / "lab/make_secrets.py", tmp_path / "lab")
    command = [sys.executable, str(tmp_path / "lab/make_secrets.py")]
    for words, told in (([], "you are root"), (["--user", "0:0"], "PostgreSQL refuses root")):
        done = subprocess.run([*command, *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert told in done.stderr
    done = subprocess.run([*command, "--user", "1234:1234"], capture_output=True, timeout=60)
    assert done.returncode == 0
    assert (tmp_path / SECRETS / "postgres").stat().st_uid == 1234
