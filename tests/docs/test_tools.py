"""The programs in `tools/`: who asks one how it is used has nothing overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.scripts import script_module
from tests.support.sources import ROOT

TOOLS = sorted((ROOT / "tools").glob("[!_]*.py"))


@pytest.mark.parametrize("path", TOOLS, ids=lambda path: path.stem)
def test_a_tool_tells_how_it_is_used(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if path.stem == "picture_operator":
        pytest.importorskip("playwright")
    monkeypatch.syspath_prepend(str(path.parent))  # As for a program.
    main = script_module(path).main
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "usage:" in capsys.readouterr().out
