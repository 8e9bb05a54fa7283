"""A simulated person at a window, with mouse and keyboard on a virtual screen, and a partner bot.

Like `players`, the process plays one episode after another and reports the same events. A
spectator's connection, the eye, shows what the person does. The process reports `pictured` when the
window shows the episode again after an outage, and `phase` when the eye sees a new phase.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import random
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path

os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"

import pygame

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille.world.world import World
from robotouille_client import Client, Game, StateChanged
from robotouille_client.bots import Policy
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.window.drawing.painter import Painter
from tests.programs.drill.games import GameSpec
from tests.programs.drill.players import Participant, Stopping, options, reachable, tell
from tests.programs.drill.witness import Witness
from tests.support.person import Person
from tests.support.screens import SIZE, Likeness, Screen, likeness, open_screen

TASK = "multi_agent/01_lettuce_burger"
PERSON, PARTNER = "robot1", "robot2"
ASIDE = ("mousemove", str(SIZE[0] - 5), str(SIZE[1] - 5))
BETWEEN_CLICKS = 0.6
LOOK_SECONDS = 0.4
PICTURE_SECONDS = 15.0
"""Time limit in seconds for the window to show the episode, while it runs with the seat taken."""
CLOSE_SECONDS = 150.0
"""Time limit in seconds for a window to receive the end of the episode and close."""
MIN_STEPS = 200
"""Smallest step limit, so that there is time to check the window after a restart."""
CHAT_EVERY = 40
"""Clicks between two chat messages of the person."""


class Window:
    """The real `robotouille-client` process on a screen."""

    def __init__(self, screen: Screen, url: str, code: str, name: str, folder: Path) -> None:
        self.screen = screen
        self._environment = {**os.environ, "DISPLAY": screen.display, "SDL_VIDEODRIVER": "x11"}
        program = "from robotouille_client.window.cli import main; main()"
        arguments = [code, "--url", url, "--name", name, "--seat", PERSON, "--linger", "1"]
        arguments += ["--screenshot", str(folder / f"{name}-end.png")]
        self._told = folder / f"{name}.log"
        self._log = self._told.open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            env=self._environment, stdout=self._log, stderr=subprocess.STDOUT,
        )  # fmt: skip

    def xdotool(self, *words: str) -> None:
        subprocess.run(["xdotool", *words], env=self._environment, check=True, timeout=20)

    def say(self, text: str) -> None:
        """Type a chat message."""
        self.xdotool("key", "t")
        self.xdotool("type", "--delay", "20", text)
        self.xdotool("key", "Return")

    @property
    def found_no_server(self) -> bool:
        """Return whether the window gave up at its start, which is allowed before play."""
        told = self._told.read_bytes()
        return b"no answer from" in told or b"cannot connect to" in told

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._log.close()


class Table:
    """Consecutive episodes with the same person."""

    def __init__(self, given: argparse.Namespace, screen: Screen) -> None:
        self._url: str = given.url
        self._seed: int = given.seed
        self._number: int = given.slots[0]
        self._max_steps = max(MIN_STEPS, given.max_steps)
        self._folder = Path(given.folder)
        self._pictures = self._folder.parent / "pictures"
        self._pictures.mkdir(exist_ok=True)
        self._screen = screen
        self._painter = Painter()
        self._chance = random.Random(f"{self._seed}:{self._number}")
        self._here = False
        self._phase = ""
        self._shown = True
        self._since = 0.0
        self._up_to_date = True

    async def run(self, stopping: Stopping) -> None:
        games = 0
        while not stopping.is_set():
            spec = GameSpec(
                task=TASK, seats=2, clock="realtime", step_rate=5.0, max_steps=self._max_steps,
                absence=("wait", "pause", "bot")[games % 3], substitute="planner",
                bots=(BotKind.PLANNER, BotKind.PLANNER), think=0.1, flaky=(False, False),
                seed=self._seed,
            )  # fmt: skip
            name = f"w{self._number}g{games}"
            try:
                await self._game(spec, name)
            except* RobotouilleError as failures:
                for failure in failures.exceptions:
                    tell("failed", who=name, error=f"{type(failure).__name__}: {failure}")
            games += 1

    async def _game(self, spec: GameSpec, name: str) -> None:
        partner = Participant(self._url, f"{name}p1", spec, 1, self._folder)
        code = await partner.open()
        tell("opened", who=name)
        async with asyncio.TaskGroup() as group, self._eye(f"{name}eye", code) as eye:
            window = await self._sit_down(eye, code, f"{name}person")
            group.create_task(partner.play(code, PARTNER))
            try:
                await self._play(eye, window, f"{name}person")
                status = await asyncio.to_thread(window.process.wait, CLOSE_SECONDS)
                if status != 0:
                    tell("failed", who=name, error=f"the window ended with status {status}")
            except subprocess.TimeoutExpired:
                tell("failed", who=name, error="the window did not close after the end")
            finally:
                window.close()

    async def _sit_down(self, eye: Client, code: str, name: str) -> Window:
        """Open the window, repeatedly if no server answers, until its seat is taken."""
        while True:
            window = Window(self._screen, self._url, code, name, self._pictures)
            while window.process.poll() is None:
                if self._seated(eye):
                    return window
                await asyncio.sleep(LOOK_SECONDS)
            window.close()
            if not window.found_no_server:
                raise RobotouilleError(f"the window ended with status {window.process.returncode}")
            await asyncio.sleep(LOOK_SECONDS)

    @asynccontextmanager
    async def _eye(self, name: str, code: str) -> AsyncIterator[Client]:
        async with reachable(self._url, name) as client:
            game = await client.join(code, role="spectator")
            witness = Witness(game, name, self._folder, self._eye_heard)
            yield client
            await witness.close()

    def _eye_heard(self, _: messages.ServerMessage) -> None:
        self._up_to_date = True

    def _sees(self, eye: Client) -> bool:
        """Return whether the eye's state comes from the server's present life."""
        if not eye.connected.is_set():
            self._up_to_date = False
        return self._up_to_date

    def _seated(self, eye: Client) -> bool:
        """Return whether the window holds its seat, according to the eye."""
        game = eye.game
        if game is None or not self._sees(eye):
            return False
        return any(seat.player == PERSON and seat.present for seat in game.seats)

    async def _play(self, eye: Client, window: Window, who: str) -> None:
        """Act through the window until the episode ends, and check the window after each outage."""
        game = eye.game
        assert game is not None
        tell("joined", who=who, episode=game.episode)
        self._here, self._shown, self._phase = False, True, ""
        hands = Hands(game, window, self._chance)
        watch = asyncio.create_task(self._watch(eye, window, who))
        try:
            while not game.ended:
                await asyncio.sleep(BETWEEN_CLICKS)
                if watch.done():
                    await watch
                if window.process.poll() is not None and self._sees(eye) and game.running:
                    status = window.process.returncode
                    raise RobotouilleError(f"the window ended during play with status {status}")
                if self._here and game.running and self._shown:
                    await hands.move()
        finally:
            watch.cancel()
        tell("over", who=who, episode=game.episode, outcome=game.outcome or {}, clicks=hands.clicks)

    async def _watch(self, eye: Client, window: Window, who: str) -> None:
        """Report when the person's seat is lost and taken again, and when the window shows it."""
        while True:
            here = self._seated(eye)
            if here != self._here:
                self._here = here
                tell("back" if here else "lost", who=who)
                self._shown, self._since = not here, time.monotonic()
            self._note_phase(eye, who)
            if here and not self._shown:
                await self._look(eye, window, who)
            await asyncio.sleep(0.05)

    def _note_phase(self, eye: Client, who: str) -> None:
        assert eye.game is not None
        if eye.game.phase != self._phase:
            self._phase = eye.game.phase
            tell("phase", who=who, phase=self._phase)

    async def _look(self, eye: Client, window: Window, who: str) -> None:
        game = eye.game
        assert game is not None
        if not game.running:
            return
        await asyncio.to_thread(window.xdotool, *ASIDE)
        await asyncio.sleep(LOOK_SECONDS)
        if not self._seated(eye) or game.ended:
            return
        picture = window.screen.picture()
        found = likeness(picture, self._painter, game, PERSON)
        late = time.monotonic() - self._since > PICTURE_SECONDS
        if found.good or late:
            self._shown = True
            self._keep(picture, who, found)
        if found.good:
            tell("pictured", who=who, tiles=found.tiles)
        elif late:
            tell("failed", who=who, error=f"the window does not show the episode: {found}")

    def _keep(self, picture: pygame.Surface, who: str, found: Likeness) -> None:
        kept = (
            self._pictures / f"{who}-{'good' if found.good else 'bad'}-{time.monotonic():.1f}.png"
        )
        pygame.image.save(picture, str(kept))


class Hands:
    """Decides the person's actions and performs them with mouse and keyboard."""

    def __init__(self, game: Game, window: Window, chance: random.Random) -> None:
        self._game = game
        self._window = window
        self._chance = chance
        self._person = Person(window.screen.display, game.world)
        self._policy: Policy | None = None
        self._last = game.step
        self.clicks = 0

    async def move(self) -> None:
        """Perform one click or key press, if there is an action."""
        self._follow()
        game = self._game
        if game.state.busy_steps(PERSON):
            return
        self.clicks += 1
        if self.clicks % CHAT_EVERY == 0:
            await asyncio.to_thread(self._window.say, f"person at {self.clicks}")
            return
        state = World(game.world.task).restore(
            game.state.facts, game.state.timer_rows(), game.state.timers.busy
        )
        if self._policy is None:
            self._policy = policy_maker(BotKind.PLANNER, 0)(state, PERSON)
        action = await asyncio.to_thread(self._policy.act, state)
        if action is None and self._chance.random() < 0.3:
            action = self._chance.choice(game.state.actions(PERSON) or (None,))
        if action is not None:
            await asyncio.to_thread(self._person.do, action)

    def _follow(self) -> None:
        """Send new events to the policy; create a new policy after a gap."""
        for event in self._game.poll():
            if not isinstance(event, StateChanged):
                continue
            if event.step == self._last + 1 and event.previous is not None:
                if self._policy is not None:
                    self._policy.observe(event.did)
            else:
                self._policy = None
            self._last = event.step


async def run(given: argparse.Namespace, screen: Screen) -> None:
    stopping = Stopping()
    obeying = asyncio.create_task(stopping.obey(lambda: [], lambda: None))
    await Table(given, screen).run(stopping)
    obeying.cancel()
    tell("finished")


def main() -> None:
    given = options()
    pygame.display.init()
    pygame.font.init()
    pygame.display.set_mode((1, 1))
    screens = Path(given.folder).parent / "screens"
    with ExitStack() as stack:
        screen = stack.enter_context(open_screen(screens / f"table{given.slots[0]}"))
        asyncio.run(run(given, screen))


if __name__ == "__main__":
    main()
