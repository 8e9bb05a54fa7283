"""`robotouille-bot MODULE:NAME`: the documented example plays, and mistakes are explained."""

import json
import subprocess
import sys
from pathlib import Path
from textwrap import dedent, indent

import pytest

from robotouille import World
from robotouille.planning.policies import Policy
from robotouille_client.bots.own_policy import OwnPolicyError, own_policy_maker
from tests.support.pages import titled
from tests.support.processes import process

STATE = World("synchronous/01").initial
BOT = [sys.executable, "-c", "from robotouille_client.bots.cli import main; main()"]


def run_bot(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*BOT, *words], capture_output=True, text=True, timeout=90, cwd=folder)


@pytest.mark.process
def test_documented_bot_plays_an_episode(tmp_path: Path) -> None:
    (tmp_path / "my_bot.py").write_text(titled("write_an_agent.md", "my_bot.py"))
    flags = ("--task", "synchronous/01", "--mode", "turn", "--max-steps", "40")
    with process(tmp_path, *flags) as (_, url, code):
        words = ["my_bot:Curious", "--url", url, "--episode", code, "--json"]
        done = run_bot(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    assert f"Curious-bot plays robot1 in {code}" in done.stderr
    outcome = json.loads(done.stdout)
    assert outcome["reason"] in ("goal", "step_limit")
    assert outcome["seats"][0]["acted"] >= 8


@pytest.mark.process
@pytest.mark.parametrize(
    ("bot", "message"),
    [
        ("plannr", "unknown bot 'plannr'; did you mean 'planner'? (possible: random, "),
        ("missing.npz", "missing.npz: cannot be read: No such file or directory"),
        ("broken.npz", "broken.npz: not a trained policy: "),
        ("no_such:Bot", "no no_such.py in "),
        ("no.such:Bot", "no no/such.py in "),
        ("bots.py:Curious", "bots.py is a file; give its module, without .py, as in bots:NAME"),
        ("bots:Curius", "bots.py has no 'Curius'; did you mean 'Curious'?"),
        ("bots:", "'bots:' is not MODULE:NAME, as in my_bot:MyPolicy"),
        ("../bots:Curious", "is not MODULE:NAME"),
        ("bots:number", "bots:number must be a class or function that takes (state, player)"),
        ("bots:Alone", "bots:Alone must be a class or function that takes (state, player)"),
        ("bots:Idle", "bots:Idle has no method 'act'"),
        ("needy:Bot", "needy needs 'no_such_library', which is not installed"),
        ("broken:Bot", "broken cannot be imported: SyntaxError: "),
        ("failing:Bot", "failing cannot be imported: ZeroDivisionError: division by zero"),
        ("script:Bot", "script cannot be imported: SystemExit: 0"),
    ],
)
def test_own_bot_mistakes_are_explained(bot: str, message: str, tmp_path: Path) -> None:
    curious = titled("write_an_agent.md", "my_bot.py")
    alone = "class Alone:\n    def __init__(self, player): ...\n"
    idle = "class Idle:\n    def __init__(self, state, player): ...\n"
    (tmp_path / "bots.py").write_text(f"{curious}\nnumber = 5\n{alone}{idle}")
    (tmp_path / "needy.py").write_text("import no_such_library\n")
    (tmp_path / "broken.py").write_text("class Bot(:\n")
    (tmp_path / "broken.npz").write_bytes(b"no archive")
    (tmp_path / "failing.py").write_text("1 / 0\n")
    (tmp_path / "script.py").write_text("raise SystemExit(0)\n")
    done = run_bot(tmp_path, bot, "--url", "ws://127.0.0.1:9")
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def own(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, body: str) -> Policy:
    """Return the policy of a class `Mine` with this body, in a module called `name`."""
    heading = "class Mine:\n    def __init__(self, state, player):\n        self.player = player\n"
    (folder / f"{name}.py").write_text(heading + indent(dedent(body), "    "))
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return own_policy_maker(f"{name}:Mine")(STATE, "robot1")


def test_policy_needs_only_act(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    act = "def act(self, state):\n    return state.actions(self.player)[0]\n"
    policy = own(tmp_path, monkeypatch, "only_act", act)
    policy.observe([])
    assert policy.act(STATE) == STATE.actions("robot1")[0]


@pytest.mark.parametrize("write", ["a.sentence", "f'[{a.sentence.upper()}]. '", "str(a)"])
def test_policy_may_return_a_sentence(
    write: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    act = f"def act(self, state):\n    a = state.actions(self.player)[1]\n    return {write}\n"
    policy = own(tmp_path, monkeypatch, f"says_{abs(hash(write))}", act)
    assert policy.act(STATE) == STATE.actions("robot1")[1]


@pytest.mark.parametrize(
    ("name", "returned", "message"),
    [
        ("flies", "'fly to moon'", r"which is not a valid action \(nearest: '"),
        ("counts", "[5]", r"returned \[5\], which is not a valid action \(expected an action, its"),
        ("hurries", "'cut(robot1, lettuce1, board1)'", r"not a valid action \([a-z]+.+\)$"),
        ("goes_on", "'x' * 10_000", "xxx…, which is not a valid action"),
    ],
)
def test_invalid_action_of_a_policy_is_explained_in_one_line(
    name: str, returned: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = own(tmp_path, monkeypatch, name, f"def act(self, state):\n    return {returned}\n")
    with pytest.raises(OwnPolicyError, match=message) as caught:
        policy.act(STATE)
    assert str(caught.value).startswith(f"{name}:Mine.act returned ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_exception_of_a_policy_shows_its_own_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = """
        def act(self, state):
            return self.go(state)
        def go(self, state):
            return state.step('fly')
    """
    policy = own(tmp_path, monkeypatch, "raises", body)
    with pytest.raises(
        OwnPolicyError, match=r"^raises:Mine\.act raised UnknownNameError: "
    ) as caught:
        policy.act(STATE)
    frames = caught.value.frames
    assert [
        line.strip() for line in frames.splitlines() if "File" not in line and "^" not in line
    ] == ["return self.go(state)", "return state.step('fly')"]


@pytest.mark.process
def test_failed_policy_leaves_its_seat(tmp_path: Path) -> None:
    heading = "class Bad:\n    def __init__(self, state, player): ...\n"
    (tmp_path / "bad.py").write_text(f"{heading}    def act(self, state): return 1 / 0\n")
    with process(tmp_path, "--task", "synchronous/01", "--mode", "turn") as (_, url, code):
        for _ in range(2):
            done = run_bot(tmp_path, "bad:Bad", "--url", url, "--episode", code)
            assert done.returncode == 1
            first, *own, last = done.stderr.splitlines()
            assert first == f"Bad-bot plays robot1 in {code}"
            assert "bad.py" in own[0]
            assert len(own) < 5
            assert last == "bad:Bad.act raised ZeroDivisionError: division by zero"
