"""`robotouille-bot MODULE:NAME`: the page's example plays, and mistakes are told plainly."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille_client.bots.own_policy import own_policy_maker
from tests.support.pages import titled
from tests.support.processes import process

BOT = [sys.executable, "-c", "from robotouille_client.bots.cli import main; main()"]


def run_bot(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*BOT, *words], capture_output=True, text=True, timeout=90, cwd=folder)


@pytest.mark.process
def test_the_bot_of_the_page_plays(tmp_path: Path) -> None:
    (tmp_path / "my_bot.py").write_text(titled("api.md", "my_bot.py"))
    flags = ("--task", "synchronous/01", "--mode", "turn", "--max-steps", "40")
    with process(tmp_path, *flags) as (_, url, code):
        words = ["my_bot:Curious", "--url", url, "--episode", code, "--json"]
        done = run_bot(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    assert f"Curious-bot plays robot1 in {code}" in done.stderr
    outcome = json.loads(done.stdout)
    assert outcome["reason"] in ("goal", "step_limit")
    assert outcome["seats"][0]["applied"] >= 8


@pytest.mark.process
@pytest.mark.parametrize(
    ("bot", "message"),
    [
        ("plannr", "there is no bot 'plannr'; possible: random, scripted"),
        ("no_such:Bot", "there is no no_such.py in "),
        ("no.such:Bot", "there is no no/such.py in "),
        ("bots:Curius", "bots.py has no 'Curius'; did you mean 'Curious'?"),
        ("bots:", "'bots:' is not MODULE:NAME, as in my_bot:MyPolicy"),
        ("../bots:Curious", "is not MODULE:NAME"),
        ("bots:number", "bots:number has to be a class or function that takes (state, player)"),
        ("bots:Alone", "bots:Alone has to be a class or function that takes (state, player)"),
        ("needy:Bot", "needy needs 'no_such_library', which is not installed"),
        ("broken:Bot", "broken cannot be imported: SyntaxError: "),
        ("failing:Bot", "failing cannot be imported: ZeroDivisionError: division by zero"),
    ],
)
def test_mistakes(bot: str, message: str, tmp_path: Path) -> None:
    curious = titled("api.md", "my_bot.py")
    alone = "class Alone:\n    def __init__(self, player): ...\n"
    (tmp_path / "bots.py").write_text(f"{curious}\nnumber = 5\n{alone}")
    (tmp_path / "needy.py").write_text("import no_such_library\n")
    (tmp_path / "broken.py").write_text("class Bot(:\n")
    (tmp_path / "failing.py").write_text("1 / 0\n")
    done = run_bot(tmp_path, bot, "--url", "ws://127.0.0.1:9")
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_policy_without_its_methods(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "half_bots.py").write_text("def half(state, player):\n    return player\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    make = own_policy_maker("half_bots:half")
    with pytest.raises(RobotouilleError, match="what half_bots:half gives has no method 'act'"):
        make(World("synchronous/01").initial, "robot1")
