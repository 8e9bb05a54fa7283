"""The certificates that are shipped are there by the names of their tasks."""

from __future__ import annotations

from pathlib import Path

import pytest

import robotouille
from robotouille import FileError, UnknownTaskError, load_certificate, load_task
from robotouille.certification import check


@pytest.mark.parametrize(
    "name", ["synchronous/01", "multi_agent/01@3", load_task("synchronous/02").instances()[0]]
)
def test_a_certificate_by_the_name_of_its_task(name: str) -> None:
    certificate, task = load_certificate(name), load_task(name)
    assert certificate == load_certificate(task)
    assert (certificate.task, certificate.seats) == (task.name.split("/")[-1], task.seats)
    assert check(certificate, task) == []
    assert isinstance(certificate, robotouille.Certificate)


def test_there_is_none_of_what_nobody_certified(tmp_path: Path) -> None:
    task = load_task("synchronous/01")
    with pytest.raises(FileError, match="timing: expected people, found benchmark"):
        load_certificate(load_task("synchronous/01", timing="people"))
    with pytest.raises(FileError, match="instance: expected"):
        load_certificate(load_task("synchronous/05", domain=altered(tmp_path)))
    with pytest.raises(UnknownTaskError):
        load_certificate("synchronous/nothing")
    with pytest.raises(FileError, match=r"certificate\.json"):
        load_certificate(type(task).from_json(task.to_json()))


def altered(folder: Path) -> str:
    """A domain in which one sentence is another."""
    shipped = robotouille.load_task("synchronous/05").domain
    text = shipped.model_dump_json(by_alias=True, exclude_unset=True)
    path = folder / "altered.json"
    path.write_text(text.replace("Do nothing", "Wait"), encoding="utf-8")
    return str(path)
