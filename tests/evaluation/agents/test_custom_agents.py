"""Agents of the user's own: the documented example, and mistakes in them."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent

import pytest
from typer.testing import CliRunner, Result

from robotouille.errors import RobotouilleError
from robotouille_client.bots.own_policy import OwnPolicyError
from robotouille_evaluation.agents import AgentObservation, ContextOverflow, Proposal
from robotouille_evaluation.agents.custom import custom_strategy
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.cli.benchmark import benchmark
from robotouille_evaluation.cli.planning import plan_run
from robotouille_evaluation.cli.run_options import RunOptions
from robotouille_evaluation.models import Completion, Message, ModelRequest
from robotouille_evaluation.models.model import Usage
from robotouille_evaluation.runs import RunFolder
from tests.support.runs import small_pack

GUIDE = (Path(__file__).parents[3] / "docs" / "evaluate_models.md").read_text(encoding="utf-8")
SANDWICH = "synchronous/01_cheese_sandwich"
SEEN = AgentObservation("A kitchen", ("Do nothing", "Cook"))


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """Return the name of a module with the documented agents, which this test may extend."""
    name = re.sub(r"\W", "_", request.node.name)
    (found,) = re.findall(r'```python title="my_agents.py"\n(.*?)```', GUIDE, re.DOTALL)
    (tmp_path / f"{name}.py").write_text(dedent("    " + found.lstrip()) + FAULTY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return name


FAULTY = """

class Broken:
    def propose(self, observation):
        raise ValueError("no idea")


class Twice:
    def propose(self, observation):
        first = yield ModelRequest((Message("user", "one"),))
        second = yield ModelRequest((Message("user", first.text),))
        return second.text


class Silent:
    def propose(self, observation):
        yield ModelRequest((Message("user", "one"),))
        return Proposal()


class Text:
    def propose(self, observation):
        yield "one"


class Number:
    def propose(self, observation):
        return 7


from robotouille_evaluation.agents import Proposal
"""


def called(*words: object) -> Result:
    return CliRunner().invoke(benchmark, [str(word) for word in words])


def answered(name: str, *answers: str) -> Proposal:
    """Return what a strategy proposes after these answers of a model."""
    steps = custom_strategy(name).propose(SEEN)
    try:
        next(steps)
        for answer in answers:
            steps.send(Completion(answer, Usage(10, 1)))
    except StopIteration as stop:
        proposal: Proposal = stop.value
        return proposal
    raise AssertionError("the strategy asks again")


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_documented_agents_are_evaluated(module: str, tmp_path: Path) -> None:
    run, agents = tmp_path / "run", f"{module}:Numbered,{module}:Walker"
    result = called("run", run, "--agents", agents, "--tasks", SANDWICH, "--limit", 1)
    assert result.exit_code == 0, result.output
    numbered, walker = sorted(RunFolder(run).rows(), key=lambda row: row.agent)
    assert (numbered.agent, walker.agent) == (f"{module}:Numbered (mock)", f"{module}:Walker")
    assert numbered.usage.prompt_tokens > 0 == walker.usage.prompt_tokens
    assert numbered.error is walker.error is None
    # The file of a run, which may come from another person, must not decide which code is run.
    refused = called("resume", run, "--agents", f"{module}:Walker")
    assert refused.exit_code == 1
    assert f"add --agents {module}:Numbered" in refused.output
    assert called("resume", run, "--agents", agents).exit_code == 0


def test_all_requests_are_recorded(module: str) -> None:
    proposal = answered(f"{module}:Twice", "two", "Cook")
    assert proposal.actions == ("Cook",)
    assert [each.request.messages[0].content for each in proposal.exchanges] == ["one", "two"]


def test_strategy_without_actions_finishes(module: str) -> None:
    strategy = custom_strategy(f"{module}:Silent")
    done = []
    for _ in range(3):
        steps = strategy.propose(SEEN)
        assert next(steps) == ModelRequest((Message("user", "one"),))
        with pytest.raises(StopIteration) as stop:
            steps.send(Completion(""))
        done.append(stop.value.value.done)
    assert done == [False, False, True]


def test_overflow_reaches_the_strategy(module: str) -> None:
    steps = custom_strategy(f"{module}:Twice").propose(SEEN)
    next(steps)
    with pytest.raises(ContextOverflow):
        steps.throw(ContextOverflow())


@pytest.mark.parametrize(
    ("agent", "fault"),
    [
        ("Broken", "propose raised ValueError: no idea"),
        ("Text", "propose yielded str; expected a ModelRequest"),
        ("Number", "propose returned int; expected an action's sentence or a Proposal"),
    ],
)
def test_mistakes_are_named(module: str, agent: str, fault: str) -> None:
    with pytest.raises(OwnPolicyError, match=fault):
        answered(f"{module}:{agent}")


@pytest.mark.usefixtures("no_report", "no_processes")
def test_mistake_ends_its_episode_only(module: str, tmp_path: Path) -> None:
    run, agents = tmp_path / "run", f"{module}:Broken,random"
    result = called("run", run, "--agents", agents, "--tasks", SANDWICH, "--limit", 1)
    assert result.exit_code == 1
    rows = {row.agent: row for row in RunFolder(run).rows()}
    assert "no idea" in str(rows[f"{module}:Broken (mock)"].error)
    assert rows["random"].error is None


@pytest.mark.parametrize(
    ("agent", "fault"),
    [("nowhere:Numbered", "no nowhere.py in"), ("my:", "is not MODULE:NAME")],
)
def test_unknown_agents_are_refused(module: str, tmp_path: Path, agent: str, fault: str) -> None:
    result = called("run", tmp_path / "run", "--agents", agent, "--tasks", SANDWICH)
    assert result.exit_code != 0
    assert fault in " ".join(result.output.split()) + str(result.exception)


def registered(folder: Path, **agents: str) -> None:
    """Install a package that registers agents."""
    metadata = folder / "my_agents-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my-agents\nVersion: 1.0\n")
    lines = [f"{name} = {target}" for name, target in agents.items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[robotouille.agents]", *lines]))


def test_agents_of_installed_packages(module: str, tmp_path: Path) -> None:
    registered(tmp_path, numbered=f"{module}:Numbered", walker=f"{module}:Walker", random="x:Y")
    listed = called("agents").output
    assert f"installed: {module}:Numbered" in listed
    assert "x:Y" not in listed  # The built-in agent has that name.

    options = RunOptions(agents="numbered,walker,random", model="mock", tasks=SANDWICH, limit=1)
    jobs = plan_run(tmp_path / "run", options).jobs
    assert [(job.agent.name, job.agent.kind) for job in jobs] == [
        (f"{module}:Numbered (mock)", "model"),
        (f"{module}:Walker", "custom"),
        ("random", "random"),
    ]
    assert make_strategy(small_pack(SANDWICH), "numbered", "synchronous").retries_left == 0


def test_installed_agent_without_its_module(module: str, tmp_path: Path) -> None:
    registered(tmp_path, gone=f"{module}_gone:Agent")
    with pytest.raises(RobotouilleError, match=f"{module}_gone"):
        plan_run(tmp_path / "run", RunOptions(agents="gone", tasks=SANDWICH))


@pytest.mark.parametrize("target", [":Agent", "module", "my module:Agent", "module:Agent!"])
def test_broken_agent_of_an_installed_package(module: str, tmp_path: Path, target: str) -> None:
    registered(tmp_path, broken=target, numbered=f"{module}:Numbered")
    why = f"the package my-agents registers {target!r}, which is not MODULE:NAME"
    listed = called("agents")
    assert listed.exit_code == 0
    assert f"cannot be used: {why}" in listed.output
    assert f"installed: {module}:Numbered" in listed.output

    options = RunOptions(agents="numbered", model="mock", tasks=SANDWICH, limit=1)
    assert len(plan_run(tmp_path / "run", options).jobs) == 1
    asked = called("run", tmp_path / "run", "--agents", "broken", "--tasks", SANDWICH)
    assert asked.exit_code == 1
    assert f"the agent 'broken' cannot be used: {why}" in " ".join(asked.output.split())
    assert not (tmp_path / "run").exists()
