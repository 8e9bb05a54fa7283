"""Make the example data set that is shipped in datasets/bot_teams (see docs/data.md).

    python tools/make_example_dataset.py             replace the shipped data set
    python tools/make_example_dataset.py FOLDER      write to a new folder

Two bots cook in simulated time in two conditions: they plan together, or each plans alone. In the
last round of each pair the second bot is absent for a while; in one pair a substitute plays for
it. No clock is read, so the same software always makes the same data.
"""

from __future__ import annotations

import argparse
import random
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

from rich.progress import track

from robotouille import World, load_task
from robotouille.episode import Absence, ActionRequest, Clock, Episode, Rules, Stepped
from robotouille.planning.policies import PlannerOptions, PlannerPolicy
from robotouille.planning.solvers import AnytimePlanner
from robotouille.replay.compression import compress
from robotouille.replay.recorder import HeaderDetails, Recorder, header
from robotouille_data.database import database_url
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import About, ExportFormat, ExportRequest
from robotouille_data.indexing import index

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "datasets" / "bot_teams"
TASK = "multi_agent/01@2"
CONDITIONS = ("together", "alone")
PAIRS = (("heron", "otter"), ("lynx", "robin"))
ROUNDS, LAST = (1, 2, 3), 3
PERIOD = 0.2
"""Duration of a step in seconds."""
AWAY = range(4, 12)
"""Steps in which the second bot is away in the last round."""
NOON = 1_767_268_800
"""Start of the first episode: 2026-01-01 12:00 UTC, in seconds since 1970."""

ABOUT = About(
    title="Bot teams in a kitchen",
    description=(
        "Two planner bots cook a lettuce burger in real time (simulated, five steps a second). "
        "In the condition `together` they share one plan. In the condition `alone` each plans "
        "as if the other stood still. Two pairs play three rounds in each condition. In the "
        "third round the second bot is absent for some seconds: a substitute plays for the bot "
        "of one pair, and nobody plays for the bot of the other. The data set is an example of "
        "an export, for people who write an analysis or try a tool."
    ),
    license="MIT",
    contact="The Robotouille engineers",
)


class Team:
    """Bots of one episode with their random generator."""

    def __init__(self, episode: Episode, planner: AnytimePlanner, alone: bool, seed: int) -> None:
        self._episode, self._dice = episode, random.Random(seed)
        world = episode.state.world
        options = PlannerOptions(seed=seed, alone=alone)
        self.bots = {
            player: PlannerPolicy(world, player, options, anytime=planner)
            for player in world.players
        }
        self._numbers = dict.fromkeys(self.bots, 0)
        self._substitute = PlannerPolicy(
            world, world.players[1], PlannerOptions(alone=True), anytime=planner
        )
        self.meet(dict.fromkeys(self.bots, "bot"))

    def meet(self, kinds: Mapping[str, str]) -> None:
        """Tell the bots which kind of participant plays each seat."""
        for bot in self.bots.values():
            bot.meet(kinds, Clock.REALTIME.value)

    def act(self, now: float, away: str | None) -> None:
        """Let every present bot act. With probability 0.15, a bot waits one step longer."""
        episode, late = self._episode, PERIOD * 0.9
        for player, bot in self.bots.items():
            if episode.state.busy_steps(player) or episode.outcome is not None:
                continue
            if player == away:
                action = self._substitute.act(episode.state)
                episode.substitute(player, action, now)
            elif self._dice.random() < 0.85:
                self._numbers[player] += 1
                action = bot.act(episode.state)
                when = now + self._dice.uniform(0.1, late)
                episode.submit(
                    player, ActionRequest(self._numbers[player], action, basis=episode.step), when
                )

    def told(self, stepped: Stepped) -> None:
        """Tell the bots what happened in a step."""
        pairs = zip(stepped.moves, stepped.attempts, strict=True)
        did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
        for bot in (*self.bots.values(), self._substitute):
            bot.observe(did)


def record(condition: str, pair: int, number: int, planner: AnytimePlanner) -> bytes:
    """Play one episode and return its recording."""
    names = PAIRS[pair]
    seed = 100 * CONDITIONS.index(condition) + 10 * pair + number
    world = World(load_task(TASK))
    absence = Absence.BOT if pair == 0 else Absence.WAIT
    grace = 0.0 if absence is Absence.BOT else 60.0  # A shorter grace would free the seat.
    rules = Rules(clock=Clock.REALTIME, step_rate=5, max_steps=60, absence=absence, grace=grace)
    episode = Episode(world, rules)
    began = NOON + 600 * seed
    recorder = Recorder(world, wall=lambda: float(began))
    labels = {
        "study": "bot-teams",
        "condition": condition,
        "pair": "-".join(names),
        "round": str(number),
        "consent": "yes",
    }
    head = header(
        world.task,
        rules,
        episode=f"{condition}-{'-'.join(names)}-{number}",
        seed=seed,
        created=f"2026-01-01T{12 + seed // 60:02}:{seed % 60:02}:00Z",
        details=HeaderDetails(labels=labels),
    )
    stream = recorder.begin(head)
    for player, name in zip(world.players, names, strict=True):
        episode.join(player, name, "bot", 0.0, participant=name)
    team = Team(episode, planner, condition == "alone", seed)
    away, now = None, 0.0
    second = world.players[1]
    while episode.outcome is None:
        wanted = second if number == LAST and episode.step in AWAY else None
        if wanted != away:
            away = wanted
            episode.set_present(second, away is None, now)
            team.meet({player: seat.controller.value for player, seat in episode.seats.items()})
        team.act(now, away)
        now += PERIOD
        episode.tick(now)
        events = list(episode.events())
        stream += recorder.record(events)
        for event in events:
            if isinstance(event, Stepped):
                team.told(event)
    return stream


def make(folder: Path) -> None:
    """Play all episodes and export them."""
    planner = AnytimePlanner(World(load_task(TASK)))
    with tempfile.TemporaryDirectory() as name:
        recordings = Path(name)
        games = list(product(CONDITIONS, range(len(PAIRS)), ROUNDS))
        for condition, pair, number in track(games):
            content = compress(record(condition, pair, number, planner))
            (recordings / f"{condition}{pair}{number}.rbt").write_bytes(content)
        url = database_url(None, recordings)
        index(url, [recordings])
        formats = (ExportFormat.PARQUET, ExportFormat.CHAT)
        export(url, folder, ExportRequest(formats, about=ABOUT))
    shutil.copy(ROOT / "LICENSE", folder / "LICENSE")


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the data set."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", metavar="FOLDER")
    folder = parser.parse_args(arguments).folder
    if folder is not None:
        make(folder)
        return
    shutil.rmtree(FOLDER, ignore_errors=True)
    make(FOLDER)


if __name__ == "__main__":
    main()
