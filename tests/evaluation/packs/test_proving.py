"""Proofs of shortest plans, stored in the pack."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from robotouille import World
from robotouille.planning.plan import Proof
from robotouille_client.cli.main import app
from robotouille_evaluation.cli import pack as commands
from robotouille_evaluation.packs.checking import prove_instances, with_instances
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import read_pack, write_pack
from tests.support.checkouts import write_checkout
from tests.support.solvers import answering, proving

pytest.importorskip("yaml")


@pytest.fixture
def pack(tmp_path: Path) -> Pack:
    return read_checkout(write_checkout(tmp_path / "checkout"), seeds=[42]).pack


def default_only(pack: Pack) -> list[PackInstance]:
    return list(prove_instances(pack, proving, kinds=["default"]))


def test_proven_plans_are_stored(pack: Pack) -> None:
    (instance,) = default_only(pack)
    made = with_instances(pack, [instance])
    assert made.digest != pack.digest
    assert made.instance(instance.id) == instance
    world = World(made.load(instance))
    assert len(made.plan(instance, world)) == instance.optimal()
    assert made.budget(instance, "own").optimal == instance.optimal()
    assert default_only(made) == []


def test_unproven_instances_stay_open(pack: Pack) -> None:
    done: list[tuple[int, int]] = []
    nothing = answering(plan=None, bound=0, proof=Proof.NONE)
    found = prove_instances(
        pack, nothing, kinds=["default"], progress=lambda *count: done.append(count)
    )
    assert list(found) == []
    assert done == [(1, 1)]


def test_command_continues_after_an_interruption(
    pack: Pack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "toast"
    write_pack(pack, folder)
    asked = 0

    def interrupted(world: World, *arguments: object, **options: object) -> object:
        nonlocal asked
        asked += 1
        if asked > 1:
            raise KeyboardInterrupt
        return proving(world)

    monkeypatch.setattr(commands, "solve", interrupted)
    result = CliRunner().invoke(app, ["pack", "prove", str(folder)])
    assert result.exit_code == 0
    assert result.stdout.startswith("1 proven now, 1 without a proven plan\n")
    monkeypatch.setattr(commands, "solve", proving)
    result = CliRunner().invoke(app, ["pack", "prove", str(folder)])
    assert result.stdout.startswith("1 proven now, 0 without a proven plan\n")
    assert read_pack(folder).digest in result.stdout
