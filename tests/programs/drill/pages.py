"""A person who plays in a browser, to whom accidents happen, and a partner bot.

Like `players`, the process plays one episode after another and reports the same events. In each
phase of an episode one accident happens to the page. The process reports it as `accident`, and a
new phase as `phase`.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import shutil
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from playwright.async_api import Error as BrowserError
from playwright.async_api import async_playwright

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille_client.bots.kinds import BotKind
from tests.programs.drill.accidents import Accident, Fates
from tests.programs.drill.games import GameSpec
from tests.programs.drill.page_witness import PageWitness
from tests.programs.drill.players import Participant, Stopping, options, reachable, retried, tell

TASK = "multi_agent/01_lettuce_burger"
PERSON, PARTNER = "robot1", "robot2"
CLOCKS = ("realtime", "lockstep", "realtime", "turn")
"""Clocks of consecutive games. Only games in real time have a countdown."""
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ["--no-sandbox", "--headless", "--disable-gpu", "--disable-quic", "--no-first-run"]
SIZES = ({"width": 1280, "height": 720}, {"width": 390, "height": 844})
GLANCE_SECONDS = 0.03
DELAYS = (0.0, 0.3, 0.8)
"""Seconds between the beginning of a phase and its accident."""
CHAT_EVERY = 12
"""Choices between two chat messages of the person."""
ANSWER_SECONDS = 30.0
"""Time after which an action without an answer counts as lost while the episode runs."""
STUCK_SECONDS = 120.0
"""Time after which a page that shows nothing to do has failed, while its server answers."""
NO_ANSWER = ("net::ERR", "chrome-error")
"""Words of errors of a browser that finds no server, or has just failed to."""

# Returns the parts of the page that a person looks at.
GLANCE = """(() => {
  const shown = (id) => document.getElementById(id)?.checkVisibility() ?? false;
  const button = document.querySelector("#cover:not([hidden]) button.main");
  return {
    form: shown("enter-form"),
    button: button?.innerText ?? "",
    cover: shown("cover") ? document.querySelector("#cover h2, #cover .count")?.innerText : "",
    choices: document.querySelectorAll("#choices button").length,
    steps: document.getElementById("progress")?.title ?? "",
  };
})()"""
PRESS = "document.querySelector('#cover:not([hidden]) button.main')?.click()"
CHOOSE = "(n) => document.querySelectorAll('#choices button')[n]?.click()"
ENTER = """(name) => {
  document.getElementById("name").value = name;
  document.getElementById("enter-form").requestSubmit();
}"""
SAY = """(text) => {
  document.getElementById("said").value = text;
  document.getElementById("say").requestSubmit();
}"""
LATER = "((real) => { Date.now = () => real() + 600_000; })(Date.now)"
"""Sets the clock on by ten minutes, as after a laptop's sleep."""


class Devices:
    """A computer and a phone; one of them shows the person's link.

    Args:
        witness: Sees the connections of both.
    """

    def __init__(self, browser: Any, url: str, witness: PageWitness) -> None:
        self.page: Any = None
        self._browser, self._url, self._witness = browser, url, witness
        self._contexts: list[Any] = []
        self._at = 0
        self.errors: list[str] = []

    async def open(self) -> None:
        """Turn both on, and open the link on the computer."""
        self._contexts = [await self._browser.new_context(viewport=size) for size in SIZES]
        await self._show()

    async def close(self) -> None:
        for context in self._contexts:
            await context.close()

    async def suffer(self, accident: Accident, seconds: float) -> None:
        """Let an accident happen, which takes some seconds unless the page is only reloaded."""
        match accident:
            case Accident.RELOADED:
                self._witness.forget()
                await self._load(again=True)
            case Accident.CLOSED:
                await self._leave()
                await asyncio.sleep(seconds)
                await self._show()
            case Accident.ASLEEP:
                await self._sleep(seconds)
            case Accident.OFFLINE:
                await self.page.context.set_offline(True)
                await asyncio.sleep(seconds)
                await self.page.context.set_offline(False)
            case Accident.MOVED:
                # The old page stays open, and must not take the seat back by itself.
                self._at = 1 - self._at
                self._witness.forget()
                await self._show()

    async def _load(self, *, again: bool = False) -> None:
        """Load the page, or load it again; repeatedly while no server answers."""
        while True:
            try:
                await (self.page.reload() if again else self.page.goto(self._url))
                return
            except BrowserError as error:
                if not any(each in str(error) for each in NO_ANSWER):
                    raise
                again = False
                await asyncio.sleep(0.3)

    async def _leave(self) -> None:
        await self.page.close()
        self._witness.forget()

    async def _show(self) -> None:
        context = self._contexts[self._at]
        for page in context.pages:
            await page.close()
        self.page = await context.new_page()
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self._witness.follow(self.page)
        await self._load()

    async def _sleep(self, seconds: float) -> None:
        tools = await self.page.context.new_cdp_session(self.page)
        await tools.send("Page.setWebLifecycleState", {"state": "frozen"})
        await asyncio.sleep(seconds)
        await tools.send("Page.setWebLifecycleState", {"state": "active"})
        await self.page.evaluate(LATER)
        await tools.detach()


class Visitor:
    """The person during one episode."""

    def __init__(
        self, name: str, devices: Devices, witness: PageWitness, chance: random.Random
    ) -> None:
        self._name, self._devices, self._witness, self._chance = name, devices, witness, chance
        self._phase = witness.phase
        self._idle_since = time.monotonic()
        self.clicks = 0

    async def play(self, fates: Fates) -> None:
        """Play until the page shows the end, with the given accidents."""
        while True:
            self._phase = self._witness.phase
            if fates.wait(self._phase):
                await asyncio.sleep(self._chance.choice(DELAYS))
                # Some pauses are short.
                if self._witness.phase != self._phase:
                    continue
                accident = fates.take(self._phase)
                tell("accident", who=self._name, phase=self._phase, how=accident)
                await self._devices.suffer(accident, self._chance.uniform(0.5, 4.0))
            seen = await self._devices.page.evaluate(GLANCE)
            if self._phase == "ended" and self._shows_end(seen):
                return
            await self._react(seen)
            self._check(seen)
            await asyncio.sleep(GLANCE_SECONDS)

    def _shows_end(self, seen: dict[str, Any]) -> bool:
        """Return whether the end card is shown, or why a new page cannot show it any more."""
        return bool(seen["cover"]) and seen["cover"] != "Connection lost"

    async def _react(self, seen: dict[str, Any]) -> None:
        """Do what a person does who wants to play on."""
        page = self._devices.page
        if seen["form"]:
            await page.evaluate(ENTER, self._name)
        elif seen["button"] and self._phase != "ended":
            if "Try again" in seen["button"]:
                self._witness.forget()
            await page.evaluate(PRESS)
        elif self._phase == "running" and seen["choices"] and not self._witness.unanswered:
            self.clicks += 1
            if self.clicks % CHAT_EVERY == 0:
                await page.evaluate(SAY, f"{self._name} after {self.clicks} choices")
            self._witness.chose()
            await page.evaluate(CHOOSE, self._chance.randrange(seen["choices"]))

    def _check(self, seen: dict[str, Any]) -> None:
        """Fail if an action stays without an answer, or if there is nothing to do for long."""
        if self._witness.unanswered_seconds > ANSWER_SECONDS:
            raise RobotouilleError(f"no answer to an action for {ANSWER_SECONDS:g} s: {seen}")
        if self._witness.here:
            self._idle_since = time.monotonic()
        elif time.monotonic() - self._idle_since > STUCK_SECONDS:
            raise RobotouilleError(f"the page is not back after {STUCK_SECONDS:g} s: {seen}")


class Table:
    """Consecutive episodes of the same person."""

    def __init__(self, given: argparse.Namespace, browser: Any) -> None:
        self._url: str = given.url
        self._seed: int = given.seed
        self._number: int = given.slots[0]
        self._steps = (given.min_steps, given.max_steps)
        self._folder = Path(given.folder)
        self._browser = browser
        self._fates = Fates(self._seed, self._number)

    async def run(self, stopping: Stopping) -> None:
        games = 0
        while not stopping.is_set():
            name = f"b{self._number}g{games}"
            try:
                await self._game(games, name)
            except* (RobotouilleError, BrowserError) as failures:
                for failure in failures.exceptions:
                    tell("failed", who=name, error=f"{type(failure).__name__}: {failure}")
            games += 1

    def _spec(self, game: int, chance: random.Random) -> GameSpec:
        return GameSpec(
            task=TASK, seats=2, clock=CLOCKS[game % len(CLOCKS)], step_rate=5.0,
            max_steps=chance.randint(*self._steps), absence=("pause", "wait", "bot")[game % 3],
            substitute="planner", bots=(BotKind.RANDOM, BotKind.RANDOM), think=0.1,
            # The partner's lost connections pause games for absence.
            flaky=(False, True), seed=self._seed + game,
        )  # fmt: skip

    async def _game(self, game: int, name: str) -> None:
        chance = random.Random(f"{self._seed}:{self._number}:{game}")
        spec = self._spec(game, chance)
        partner = Participant(self._url, f"{name}p1", spec, 1, self._folder)
        created = await self._open(name, spec)
        tell("opened", who=name, seats=2)
        async with asyncio.TaskGroup() as group:
            group.create_task(partner.play(created.code, PARTNER))
            await self._visit(f"{name}person", created, chance)

    async def _open(self, name: str, spec: GameSpec) -> messages.Created:
        async with reachable(self._url, name) as client:
            return await retried(lambda: client.create(spec.task, tokens=True, **spec.options))

    async def _visit(self, name: str, created: messages.Created, chance: random.Random) -> None:
        url = f"http://{urlsplit(self._url).netloc}/play#{created.links[PERSON]}"
        witness = PageWitness(
            created.episode, PERSON, name, self._folder,
            lambda event, **facts: tell(event, who=name, page=True, **facts),
        )  # fmt: skip
        devices = Devices(self._browser, url, witness)
        visitor = Visitor(name, devices, witness, chance)
        tell("joined", who=name, episode=created.episode)
        tell("phase", who=name, page=True, phase=witness.phase)
        try:
            await devices.open()
            self._fates.begin()
            await visitor.play(self._fates)
        finally:
            await devices.close()
            witness.close()
            for fault in [*witness.faults, *devices.errors]:
                tell("failed", who=name, error=fault)
            if witness.sent > visitor.clicks:
                error = f"{visitor.clicks} choices became {witness.sent} actions"
                tell("failed", who=name, error=error)
        tell("over", who=name, episode=created.episode, outcome=witness.outcome,
             clicks=visitor.clicks)  # fmt: skip


@asynccontextmanager
async def launched() -> AsyncIterator[Any]:
    async with async_playwright() as driver:
        browser = await driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        await browser.close()


async def run(given: argparse.Namespace) -> None:
    stopping = Stopping()
    async with launched() as browser:
        obeying = asyncio.create_task(stopping.obey(lambda: [], lambda: None))
        await Table(given, browser).run(stopping)
        obeying.cancel()
    tell("finished")


def main() -> None:
    asyncio.run(run(options()))


if __name__ == "__main__":
    main()
