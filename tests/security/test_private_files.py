"""Private files: access, atomic writes, errors."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import pytest

from robotouille_server.auth.private_files import (
    PrivateFileError,
    fingerprint,
    locked,
    read_private,
    write_private,
)

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="modes of POSIX")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "keys.json"


def test_only_the_owner_may_read_written_files(path: Path) -> None:
    write_private(path, b"secret", replace=False)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert read_private(path, 100) == b"secret"
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_existing_file_is_replaced_only_on_request(path: Path) -> None:
    write_private(path, b"first", replace=False)
    with pytest.raises(FileExistsError):
        write_private(path, b"second", replace=False)
    assert path.read_bytes() == b"first"
    before = fingerprint(path)
    write_private(path, b"second", replace=True)
    assert path.read_bytes() == b"second"
    assert fingerprint(path) != before
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("mode", [0o644, 0o660, 0o602])
def test_file_accessible_to_others_is_refused(path: Path, mode: int) -> None:
    path.write_bytes(b"secret")
    path.chmod(mode)
    with pytest.raises(PrivateFileError, match="other users may access it"):
        read_private(path, 100)


def test_errors_name_the_file(path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_private(path, 100)
    write_private(path, b"x" * 101, replace=False)
    with pytest.raises(PrivateFileError, match=r"keys\.json: larger than 100 bytes"):
        read_private(path, 100)
    with pytest.raises(PrivateFileError, match="cannot be written"):
        write_private(path / "inside", b"", replace=False)
    with pytest.raises(PrivateFileError, match="cannot be opened"), locked(path / "nowhere"):
        pass
    assert fingerprint(path / "nowhere") is None
