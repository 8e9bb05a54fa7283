"""Git ignores keys and personal data where the commands of the guides put them."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from tests.support.pages import read
from tests.support.sources import ROOT

FIXED = (
    "recordings.state/keys.json",
    "recordings.state/audit.log",
    "recordings.state/used-tokens/x",
    "elsewhere/recordings.state/keys.json",
    "recordings/a.rbt",
    "elsewhere/recordings/a.rbt.part",
    "recordings/catalogue.sqlite-wal",
    "lab/data/postgres/x",
    "lab/secrets/pgpass",
    ".env",
    "mqtt.password",
)


def named() -> set[str]:
    """Return the backups and tables of codes that the guide makes."""
    commands = re.findall(r"^ *\$ (.*)$", read("run_a_study.md"), re.MULTILINE)
    found = re.findall(r"(?:\bsave|--out) (\S+)", "\n".join(commands))
    assert {"backup-1.tar", "backup-2.tar", "opened.csv"} <= set(found)
    return set(found)


@pytest.mark.process
@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a clone")
def test_secrets_are_ignored() -> None:
    paths = sorted({*FIXED, *named()})
    command = ["git", "check-ignore", "--no-index", *paths]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == paths
    listed = ["git", "ls-files", "--cached", "--ignored", "--exclude-standard"]
    kept = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert kept.stdout == "", "files of the repository are ignored"
