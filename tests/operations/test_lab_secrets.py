"""`lab/make_secrets.py` creates private files and keeps existing ones."""

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


def test_all_secrets_of_compose_are_created_private(tmp_path: Path) -> None:
    made = list(lab.make(tmp_path, USER))
    files = {
        secret["file"] for secret in compose({"LAB_SECRETS": "./lab/secrets"})["secrets"].values()
    }
    assert {name for name in made if name != ".env"} >= {file.removeprefix("./") for file in files}
    for path in (tmp_path / ".env", *tmp_path.glob("lab/data/*"), *tmp_path.glob("lab/secrets/*")):
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path


def test_mounted_folders_are_created(tmp_path: Path) -> None:
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


def test_every_variable_is_used_by_compose(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    text = (ROOT / "docker-compose.yml").read_text()
    for line in (tmp_path / ".env").read_text().splitlines():
        name = line.partition("=")[0]
        assert f"${{{name}:-" in text or name == "COMPOSE_PROFILES"


def test_existing_secrets_are_kept(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    before = content(tmp_path)
    assert list(lab.make(tmp_path, USER)) == []
    assert content(tmp_path) == before


def test_secrets_differ(tmp_path: Path) -> None:
    for name in ("one", "two"):
        list(lab.make(tmp_path / name, USER))
    found = [
        (tmp_path / name / SECRETS / file).read_text()
        for name in ("one", "two")
        for file in lab.PASSWORDS
    ]
    assert len(set(found)) == len(found)
    assert all(len(password) == 48 for password in found)


def test_readable_secret_is_reported(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "postgres").chmod(0o644)
    with pytest.raises(lab.LabError, match=r"postgres is open to others \(mode 0644\); run `chmod"):
        list(lab.make(tmp_path, USER))


def test_empty_secret_is_reported(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "pgpass").write_text("")
    with pytest.raises(lab.LabError, match="pgpass is empty; delete it"):
        list(lab.make(tmp_path, USER))


def test_missing_password_with_existing_users_is_reported(tmp_path: Path) -> None:
    list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "postgres_owner").unlink()
    with pytest.raises(
        lab.LabError, match="pgpass was made from postgres_owner, which is missing; delete"
    ):
        list(lab.make(tmp_path, USER))
    (tmp_path / SECRETS / "pgpass").unlink()
    assert list(lab.make(tmp_path, USER)) == ["lab/secrets/postgres_owner", "lab/secrets/pgpass"]


@pytest.mark.process
@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
def test_root_must_name_the_user(tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    shutil.copy(ROOT / "lab/make_secrets.py", tmp_path / "lab")
    command = [sys.executable, str(tmp_path / "lab/make_secrets.py")]
    for options, message in (
        ([], "cannot run as root"),
        (["--user", "0:0"], "PostgreSQL refuses root"),
    ):
        done = subprocess.run([*command, *options], capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert message in done.stderr
    subprocess.run([*command, "--user", "1234:1234"], capture_output=True, timeout=60, check=True)
    assert (tmp_path / SECRETS / "postgres").stat().st_uid == 1234
