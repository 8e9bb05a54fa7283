"""Make the data set that is shipped as an example (docs/data.md): datasets/bot_teams.

    python tools/make_example_dataset.py             in place of the one that is there
    python tools/make_example_dataset.py FOLDER      into a new folder

Two bots cook in simulated time, in two conditions: they plan together, or each alone. In the last
round of each pair the second bot is away for a while, and a stand-in plays or nobody does. Nothing
here reads a clock, so that the same software makes the same data.
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
from robotouille.episode import Absence, Clock, Episode, Rules, Stepped
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.policies import PlannerPolicy
from robotouille.replay.container import compress
from robotouille.replay.recorder import Recorder, header
from robotouille_data.database import database_url
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import About, ExportFormat, Request
from robotouille_data.indexing import index

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "datasets" / "bot_teams"
TASK = "multi_agent/01@2"
CONDITIONS = ("together", "alone")
PAIRS = (("heron", "otter"), ("lynx", "robin"))
ROUNDS, LAST = (1, 2, 3), 3
PERIOD = 0.2
"""Seconds of a step."""
AWAY = range(4, 12)
"""The steps for which the second bot is away in the last round."""
NOON = 1_767_268_800
"""When the first episode began, in seconds since 1970: 2026-01-01 at 12:00, UTC."""

ABOUT = About(
    title="Bot teams in a kitchen",
    description=(
        "Two planner bots cook a lettuce burger in real time (simulated, five steps a second), in "
        "two conditions: they plan `together`, or each plans `alone`, as if the other stood still. "
        "Each of two pairs plays three rounds in each condition. In the third, the second bot is "
        "away for some seconds: of one pair a stand-in plays for it, of the other nobody does. "
        "The data are an example of an export, for those who write an analysis or try a tool."
    ),
    license="MIT",
    contact="The Robotouille engineers",
)


class Team:
    """The bots of one episode, and their dice."""

    def __init__(self, episode: Episode, planner: AnytimePlanner, alone: bool, seed: int) -> None:
        self._episode, self._dice = episode, random.Random(seed)
        world = episode.state.world
        self.bots = {
            player: PlannerPolicy(world, player, seed=seed, alone=alone, anytime=planner)
            for player in world.players
        }
        self._numbers = dict.fromkeys(self.bots, 0)
        self._stand_in = PlannerPolicy(world, world.players[1], alone=True, anytime=planner)
        self.meet(dict.fromkeys(self.bots, "bot"))

    def meet(self, kinds: Mapping[str, str]) -> None:
        """Tell the bots who moves the seats."""
        for bot in self.bots.values():
            bot.meet(kinds, Clock.REALTIME.value)

    def act(self, now: float, away: str | None) -> None:
        """Everybody who is there decides; now and then somebody takes a step longer."""
        episode, late = self._episode, PERIOD * 0.9
        for player, bot in self.bots.items():
            if episode.state.busy_steps(player) or episode.outcome is not None:
                continue
            if player == away:
                action = self._stand_in.act(episode.state)
                episode.substitute(player, action, now)
            elif self._dice.random() < 0.85:
                self._numbers[player] += 1
                action = bot.act(episode.state)
                when = now + self._dice.uniform(0.1, late)
                episode.submit(player, self._numbers[player], action, when, basis=episode.step)

    def told(self, stepped: Stepped) -> None:
        """A step was taken."""
        pairs = zip(stepped.moves, stepped.attempts, strict=True)
        did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
        for bot in (*self.bots.values(), self._stand_in):
            bot.observe(did)


def record(condition: str, pair: int, number: int, planner: AnytimePlanner) -> bytes:
    """The recording of one episode."""
    names = PAIRS[pair]
    seed = 100 * CONDITIONS.index(condition) + 10 * pair + number
    world = World(load_task(TASK))
    absence = Absence.BOT if pair == 0 else Absence.WAIT
    grace = 0.0 if absence is Absence.BOT else 60.0  # Then the seat would be given up.
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
        labels=labels,
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
    """Play, and write the export."""
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
        export(url, folder, Request(formats, about=ABOUT))
    shutil.copy(ROOT / "LICENSE", folder / "LICENSE")


def main(arguments: Sequence[str] | None = None) -> None:
    """Make it."""
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
