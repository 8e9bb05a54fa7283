"""The page in a real browser: people who play by mouse, keyboard and touch, from a link alone."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille import GroundAction, State, World, load_task
from robotouille.domain.rendering import language_of
from robotouille.episode import Clock
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
from robotouille.protocol import messages
from robotouille.replay.recording import read_recording
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.unserved import unserved
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import useful_actions
from robotouille_client import connect
from robotouille_client.bots.kinds import BotKind, BotSetup, policy_maker
from robotouille_client.bots.seat_session import SeatRequest, play_seat
from robotouille_client.window.sources.texts import unserved_words
from robotouille_server import Server
from robotouille_server.requests import Opening, open_episode
from robotouille_server.rooms.room import Room
from tests.operations.proxies import PROXIES, program
from tests.support.firefox import FIREFOX, FirefoxPage, firefox_page
from tests.support.servers import serving
from tests.support.worker_processes import free_ports
from tests.web.visits import (
    BROWSER_TEST,
    DESKTOP,
    PATIENCE,
    PHONE,
    expect,
    get_ready,
    link,
    playing,
    visiting,
)

pytestmark = BROWSER_TEST

ALONE, TOGETHER = "synchronous/01_cheese_sandwich", "multi_agent/01_lettuce_burger"
CUTTING = "synchronous/02_lettuce_sandwich"
TEXT_OF = "((query) => document.querySelector(query).innerText)"
BUTTON_WITH = "((words) => [...document.querySelectorAll('#choices button')]"
BUTTON_WITH += ".find((button) => button.innerText === words))"
FOCUSED_CHOICE = """(() => {
  const buttons = [...document.querySelectorAll("#choices button")];
  const place = buttons.indexOf(document.activeElement);
  return place < 0 ? null : place;
})()"""
OVERLAP = """() => {
  const [one, other] = ["cover", "kitchen"].map((id) =>
    document.getElementById(id).getBoundingClientRect());
  return Math.max(0, Math.min(one.bottom, other.bottom) - Math.max(one.top, other.top));
}"""
"""Returns the pixels by which a card covers the kitchen."""
ENTER = "\ue007"
"""The key Enter in WebDriver."""


async def at_step(page: Any, step: int) -> None:
    await expect(page.locator("#progress")).to_have_text(re.compile(rf"\b{step} of \d+ steps"))


def planned(task: str) -> Iterator[tuple[State, GroundAction, str]]:
    """Yield each action of a shipped plan for one player, with its state and its words."""
    world = World(load_task(task))
    plan = (data_folder("problems") / f"{task}.plan").read_text(encoding="utf-8")
    wording, state = Wording(world, language_of(world.task), world.players[0]), world.initial
    for joint in read_plan(plan, world):
        for action in joint:
            yield state, action, capitalised(wording.action(action, state))
        state = state.step(list(joint)).state


def together(task: str) -> Iterator[dict[str, str]]:
    """Yield the words of each player's action in each step of a game that follows a shipped plan.

    A plan may rely on an action of the same step, which nobody is offered. That player waits.
    """
    world = World(load_task(task))
    path = data_folder("problems") / f"{task}.plan"
    state = world.initial
    for joint in read_plan(path.read_text(encoding="utf-8"), world):
        rest = list(joint)
        while rest:
            now = [action for action in rest if action in state.actions(str(action.player))]
            acting = {str(action.player): action for action in now}
            yield {player: words_of(state, player, acting.get(player)) for player in world.players}
            state = state.step(now).state
            rest = [action for action in rest if action not in now]
    assert state.goal_reached


def words_of(state: State, player: str, action: GroundAction | None) -> str:
    if action is None:
        return "Wait"
    return capitalised(wording(state, player).action(action, state))


def wording(state: State, player: str) -> Wording:
    return Wording(state.world, language_of(state.world.task), player)


async def by_buttons(page: Any, words: str) -> None:
    """Choose an action from the list."""
    button = page.locator("#choices").get_by_role("button", name=words, exact=True).first
    await button.focus()
    await page.keyboard.press("Enter")


async def spot_of(page: Any, words: str) -> tuple[float, float] | None:
    """Return a point of the kitchen whose tip says these words."""
    box = await page.locator("#kitchen").bounding_box()
    for row in range(1, 24):
        for column in range(1, 24):
            x, y = box["x"] + box["width"] * column / 24, box["y"] + box["height"] * row / 24
            await page.mouse.move(x, y)
            if (await page.locator("#kitchen").get_attribute("title")) == words:
                return x, y
    return None


class Keyboard:
    """A person with a keyboard alone."""

    size = DESKTOP

    async def enter(self, page: Any, name: str) -> None:
        await expect(page.locator("#name")).to_be_focused()
        await page.keyboard.type(name)
        await page.keyboard.press("Enter")

    async def answer(self, page: Any, words: str) -> None:
        """Press the button of a card, which has the focus."""
        await expect(page.get_by_role("button", name=words)).to_be_focused()
        await page.keyboard.press("Enter")

    async def act(self, page: Any, words: str) -> None:
        """Go to the list with Tab and to the action with the arrow keys, and press Enter."""
        place = None
        for _ in range(6):
            place = await page.evaluate(FOCUSED_CHOICE)
            if place is not None:
                break
            await page.keyboard.press("Tab")
        choices = await page.locator("#choices button").all_inner_texts()
        way = choices.index(words) - place
        for _ in range(abs(way)):
            await page.keyboard.press("ArrowDown" if way > 0 else "ArrowUp")
        await page.keyboard.press("Enter")


class Mouse:
    """A person with a mouse, and a keyboard for the name alone."""

    size = DESKTOP

    def __init__(self) -> None:
        self._last = 0.0, 0.0

    async def enter(self, page: Any, name: str) -> None:
        await page.click("#name")
        await page.keyboard.type(name)
        await page.click("#enter-button")

    async def answer(self, page: Any, words: str) -> None:
        await page.get_by_role("button", name=words).click()

    async def act(self, page: Any, words: str) -> None:
        """Click where the tip has these words; for other work, right-click at the own place."""
        spot = await spot_of(page, words)
        self._last = spot or self._last
        await page.mouse.click(*self._last, button="left" if spot else "right")


class Touch:
    """A person with a phone."""

    size = PHONE

    async def enter(self, page: Any, name: str) -> None:
        await page.tap("#name")
        await page.keyboard.type(name)
        await page.tap("#enter-button")

    async def answer(self, page: Any, words: str) -> None:
        await page.get_by_role("button", name=words).tap()

    async def act(self, page: Any, words: str) -> None:
        """Tap on the kitchen, or on the list for work that a tap there does not stand for."""
        spot = await spot_of(page, words)
        if spot is not None:
            await page.touchscreen.tap(*spot)
        else:
            await page.locator("#choices").get_by_role("button", name=words, exact=True).tap()


@pytest.mark.parametrize("kind", [Keyboard, Mouse, Touch])
async def test_whole_task_is_played_in_a_browser(browser: Any, tmp_path: Path, kind: Any) -> None:
    person = kind()
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task=CUTTING, clock="lockstep"))
        url, touch = link(server.port, room.code), kind is Touch
        async with visiting(
            browser, url, "Ada", person.size, enter=person.enter, has_touch=touch
        ) as page:
            await person.answer(page, "I'm ready")
            for step, (_, _, words) in enumerate(planned(CUTTING)):
                await at_step(page, step)
                await person.act(page, words)
            await expect(page.locator("#cover")).to_contain_text("Goal reached")
            await expect(page.locator(".dish li:not(.done)")).to_have_count(0)
            limits = room.find_star_limits()
            assert limits is not None
            told = f"Three stars need at most {limits.three} steps."
            await expect(page.locator("#cover")).to_contain_text(told)
            await expect(page.locator(".stars")).to_have_attribute("aria-label", "3 / 3")
            assert await page.evaluate(OVERLAP) == 0
            await person.answer(page, "Play again")
            await expect(page.locator("#cover")).to_contain_text("Waiting room")
    recording = read_recording(next(tmp_path.glob("*.rbt")))
    assert recording.outcome is not None
    assert recording.outcome["reason"] == "goal"
    assert recording.participants == {"robot1": ("Ada", "human")}


async def test_page_says_why_a_dish_is_not_served(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="shifts/01@1", clock="lockstep"))
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            await get_ready(page)
            step = 0
            await at_step(page, step)
            for station in ("crate1", "hatch1") * 2:
                for there in (station, None):
                    state = room.episode.state
                    action = next(
                        each
                        for each in useful_actions(state, "robot1")
                        if station in each.arguments and each.destination == there
                    )
                    await by_buttons(page, words_of(state, "robot1", action))
                    step += 1
                    await at_step(page, step)
            (found,) = unserved(room.episode.state, wording(room.episode.state, "robot1"))
            assert found.fault
            await expect(page.locator("#notice")).to_have_text(unserved_words(found))


def opened_room(server: Server, **options: Any) -> Room:
    rules = {"task": f"{TOGETHER}@2", "clock": "realtime", "step_rate": 10, "max_steps": 5000}
    return server.lobby.create(messages.Create(**{**rules, **options}))


def names(room: Room) -> list[str]:
    return [seat.name for seat in room.episode.seats.values()]


async def test_two_people_chat_signal_and_see_each_other(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            await ada.keyboard.press("t")
            await ada.keyboard.type("<img src=x onerror=alert(1)> & <b>hi</b>")
            await ada.keyboard.press("Enter")
            for page in (ada, ben):
                await expect(page.locator("#lines")).to_contain_text("Ada: <img src=x")
            assert await ben.locator("#lines b").count() == 1, "only the speaker's name is bold"
            await ben.get_by_role("button", name="Thanks").click()
            await expect(ada.locator(".bubble", has_text="Thank you")).to_be_visible()
            await expect(ada.locator("#seats")).to_contain_text("Ben")
            ben.on("dialog", lambda dialog: dialog.accept())
            await ben.get_by_role("button", name="Leave").click()
            await expect(ada.locator("#lines")).to_contain_text("Ben left")


async def test_busy_chat_is_not_read_out_from_its_beginning(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            for number in range(6):
                await ben.keyboard.press("t")
                await ben.keyboard.type(f"line {number}")
                await ben.keyboard.press("Enter")
                await expect(ada.locator("#live")).to_contain_text(f"line {number}")
                await asyncio.sleep(0.4)
            await expect(ada.locator("#live")).not_to_contain_text("line 0", timeout=1)


async def test_lost_network_is_shown_and_play_goes_on(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            await ada.context.set_offline(True)
            await expect(ada.locator("#cover")).to_contain_text("Connection lost")
            await expect(ben.locator("#lines")).to_contain_text("Ada is away")
            await ada.context.set_offline(False)
            await expect(ada.locator("#cover")).to_be_hidden()
            await expect(ben.locator("#lines")).to_contain_text("Ada is back")


async def test_rejection_says_what_is_missing(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server, step_rate=1)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            # Both choose the only place at the stove in the same step; the second seat is too late.
            pages = dict(zip(("Ada", "Ben"), (ada, ben), strict=True))
            first, second = names(room)
            for name in (first, second):
                await by_buttons(pages[name], "Go to the stove")
            bubble = pages[second].locator(".bubble.rejected")
            await expect(bubble).to_have_text(f"{first} stands at the stove")


async def test_reload_returns_to_the_seat_and_a_second_window_takes_it(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            before = names(room)
            await ada.reload()
            await expect(ada.locator("#seats")).to_contain_text("Ada")
            await expect(ada.locator("#choices li").first).to_be_visible()
            assert names(room) == before
            second = await ada.context.new_page()
            await second.goto(link(server.port, room.code))
            await expect(second.locator("#choices li").first).to_be_visible()
            await expect(ada.locator("#cover")).to_contain_text("playing in another window")
            await ada.get_by_role("button", name="Play here").click()
            await expect(second.locator("#cover")).to_contain_text("playing in another window")
            await expect(ben.locator("#seats")).not_to_contain_text("2")


async def test_personal_link_moves_its_person_to_another_browser(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path, require_token=True) as server:
        request = messages.Create(
            task=f"{TOGETHER}@2", clock="realtime", tokens=True, participants={"robot1": "P1"}
        )
        room, created = open_episode(server.services, Opening(request=request, owner="lab"))
        fragments = created.links["robot1"], created.links["robot2"]
        links = link(server.port, fragments[0]), link(server.port, fragments[1])
        async with playing(browser, links) as (ada, ben):
            assert room.episode.seats["robot1"].name == "Ada"
            async with visiting(browser, links[0], "Ada", PHONE) as phone:
                await expect(phone.locator("#choices li").first).to_be_visible()
                await expect(ada.locator("#cover")).to_contain_text("another window")
                assert names(room) == ["Ada", "Ben"]
                await expect(ben.locator("#seats")).to_contain_text("Ada")


async def test_two_people_with_links_share_a_browser(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path, require_token=True) as server:
        request = messages.Create(task=f"{TOGETHER}@2", tokens=True)
        room, created = open_episode(server.services, Opening(request=request, owner="lab"))
        first, second = created.links.values()
        async with visiting(browser, link(server.port, first), "Ada") as ada:
            await expect(ada.locator("#cover")).to_contain_text("Waiting room")
            await ada.fill("#said", "hello")
            ben = await ada.context.new_page()
            await ben.goto(link(server.port, second))
            await ben.fill("#name", "Ben")
            await ben.click("#enter-button")
            await expect(ada.locator("#cover")).to_contain_text("Ben")
            await ada.keyboard.type(" Ben")
            assert await ada.input_value("#said") == "hello Ben", "the waiting room took the focus"
            for page in (ada, ben):
                await page.reload()
                await expect(page.locator("#cover")).to_contain_text("Waiting room")
            assert names(room) == ["Ada", "Ben"]


async def test_code_in_another_spelling_returns_to_the_same_seat(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        plain = room.code.replace("-", "").lower()
        async with visiting(browser, link(server.port, plain), "Ada") as page:
            await expect(page.locator("#cover")).to_contain_text("Waiting room")
            await page.reload()
            await expect(page.locator("#cover")).to_contain_text("Waiting room")
            assert sorted(names(room)) == ["", "Ada"]


async def test_page_survives_a_restart_of_the_server(browser: Any, tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(tmp_path))
        room = opened_room(server)
        port = server.port
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            before = names(room)
            await server.stop("restart", hand_over=True)
            await expect(ada.locator("#cover")).to_contain_text("Connection lost")
            again = await stack.enter_async_context(serving(tmp_path, port=port, seed=2))
            for page in (ada, ben):
                await expect(page.locator("#cover")).to_be_hidden()
            room = again.lobby.rooms[room.id]
            step = room.episode.step
            await expect(ada.locator("#progress")).not_to_have_attribute(
                "title", f"{step} of 5000 steps"
            )
            assert names(room) == before


async def test_broken_link_leads_to_the_form(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        async with visiting(browser, link(server.port, "%"), "Ada") as page:
            await expect(page.locator("#cover")).to_contain_text("This kitchen does not exist")


async def test_consent_is_asked_for_and_recorded(browser: Any, tmp_path: Path) -> None:
    url = "https://lab.example/information"
    async with serving(tmp_path, page_consent=url) as server:
        room = server.lobby.create(messages.Create(task=ALONE, clock="lockstep", max_steps=1))
        async with visiting(browser, link(server.port, room.code), "Ada") as page:
            await expect(page.locator("#enter-fault")).to_contain_text("tick the box")
            assert await page.locator("#consent-link").get_attribute("href") == url
            await page.get_by_role("checkbox").check()
            await page.click("#enter-button")
            for number in range(2):
                await get_ready(page)
                await by_buttons(page, "Wait")
                await expect(page.locator("#cover")).to_contain_text("Time is up")
                if number == 0:
                    await page.reload()
                    await page.get_by_role("button", name="Play again").click()
    recordings = [read_recording(path) for path in tmp_path.glob("*.rbt")]
    assert len(recordings) == 2
    for recording in recordings:
        notes = [note for note in recording.notes() if note.get("topic") == "consent"]
        assert [note["text"] for note in notes] == [url]


async def test_rematch_leads_both_to_the_next_game(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server, max_steps=3)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, ben):
            for page in (ada, ben):
                await expect(page.locator("#cover")).to_contain_text("Time is up")
            await ada.reload()
            await ada.get_by_role("button", name="Play again").click()
            await expect(ada.locator("#cover")).to_contain_text("Waiting room")
            await ben.get_by_role("button", name="Join the next game").click()
            await expect(ben.locator("#cover")).to_contain_text("Waiting room")
            (again,) = (each for each in server.lobby.rooms.values() if each.id != room.id)
            assert sorted(names(again)) == ["Ada", "Ben"]


async def test_page_that_is_reloaded_after_the_end_shows_no_actions(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server, max_steps=3)
        async with playing(browser, (link(server.port, room.code),) * 2) as (ada, _):
            await expect(ada.locator("#cover")).to_contain_text("Time is up")
            await ada.reload()
            await expect(ada.locator("#cover")).to_contain_text("Time is up")
            await expect(ada.locator(".dish li")).not_to_have_count(0)
            await expect(ada.locator("#actions")).to_be_hidden()


async def test_player_learns_which_bots_come_along(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server, max_steps=3)
        async with connect(server.url, name="Robo", kind="bot") as client:
            await client.join(room.code)
            async with visiting(browser, link(server.port, room.code), "Ada") as page:
                await get_ready(page)
                await expect(page.locator("#cover")).to_contain_text("Not every bot comes along")


async def test_spectator_watches_and_a_full_kitchen_offers_to_watch(
    browser: Any, tmp_path: Path
) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        async with playing(browser, (link(server.port, room.code),) * 2) as _:
            async with visiting(browser, link(server.port, room.code, "watch"), "Eve") as eve:
                await expect(eve.locator("#status")).to_have_text("You are watching")
                assert await eve.locator("#actions").is_hidden()
            async with visiting(browser, link(server.port, room.code), "Zoe") as zoe:
                await expect(zoe.locator("#cover")).to_contain_text("All seats are taken")
                await zoe.get_by_role("button", name="Watch").click()
                await expect(zoe.locator("#status")).to_have_text("You are watching")


@pytest.mark.parametrize(
    ("fragment", "words"),
    [
        ("KQXZB-MHTWA", "This kitchen does not exist"),
        ("nonsense%20%3Cb%3E", "This kitchen does not exist"),
        ("KQXZB-MHTWA.JgehIHJvYm90MgEjRWeJq83vL9MSyjTSgyocijES", "does not accept your link"),
    ],
)
async def test_wrong_link_says_what_is_wrong(
    browser: Any, tmp_path: Path, fragment: str, words: str
) -> None:
    async with serving(tmp_path) as server:
        async with visiting(browser, link(server.port, fragment), "Ada") as page:
            await expect(page.locator("#cover")).to_contain_text(words)


async def test_reader_of_german_and_of_a_kitchen_of_its_own(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = server.lobby.create(messages.Create(task="workshop/01_painted_gear"))
        async with visiting(browser, link(server.port, room.code), "Ada", locale="de-DE") as page:
            await page.get_by_role("button", name="Ich bin bereit").click()
            await expect(page.locator("#bar")).to_contain_text("Schritt 0 von")
            await expect(page.locator("#choices li").first).to_be_visible()


async def test_page_plays_with_another_client(browser: Any, tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        room = opened_room(server)
        async with connect(server.url, name="Robo", kind="bot") as client:
            game = await client.join(room.code)
            async with visiting(browser, link(server.port, room.code), "Ada") as page:
                await get_ready(page)
                await expect(page.locator("#seats")).to_contain_text("Robo")
                await expect(page.locator("#choices li").first).to_be_visible()
                await page.keyboard.press("ArrowUp")
                await page.keyboard.press("e")
                await expect(page.locator("#progress")).not_to_have_attribute(
                    "title", re.compile("^[0-3] of")
                )
            assert game.step > 0


PARENT = """<!doctype html><iframe id="game" style="width: 1000px; height: 700px"></iframe>
<script>
  window.heard = [];
  addEventListener("message", ({ data, origin }) => heard.push({ ...data, origin }));
  window.show = (src) => { document.getElementById("game").src = src; };
  window.tell = (type) => document.getElementById("game").contentWindow.postMessage({ type }, "*");
</script>"""


@asynccontextmanager
async def site() -> AsyncIterator[str]:
    """Serve a page of another site, which can show the game in a frame; yield its origin."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        head = "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nConnection: close\r\n\r\n"
        writer.write((head + PARENT).encode())
        writer.close()

    # A name of the same machine: browsers ask people before a public site may reach it.
    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    async with server:
        yield f"http://localhost:{server.sockets[0].getsockname()[1]}"


@asynccontextmanager
async def survey(browser: Any, origin: str, url: str) -> AsyncIterator[Any]:
    """Open a page of a site that shows a game in a frame."""
    context = await browser.new_context(viewport=DESKTOP)
    page = await context.new_page()
    page.set_default_timeout(PATIENCE)
    await page.goto(f"{origin}/survey")
    await page.evaluate("(url) => show(url)", url)
    try:
        yield page
    finally:
        await context.close()


async def test_survey_shows_a_game_and_learns_its_outcome(browser: Any, tmp_path: Path) -> None:
    async with site() as lab, serving(tmp_path, page_parents=lab) as server:
        room = server.lobby.create(
            messages.Create(task=ALONE, clock="realtime", step_rate=10, max_steps=4)
        )
        query = f"?embed={lab}&name=P07&return={lab}/thanks#{room.code}"
        own = f"http://127.0.0.1:{server.port}"
        async with survey(browser, lab, f"{own}/play{query}") as page:
            await page.wait_for_function("heard.some(({ type }) => type === 'ready')")
            assert names(room) == ["P07"]
            await page.evaluate("tell('__proto__'); tell('ready')")
            await page.wait_for_function("heard.some(({ type }) => type === 'ended')")
            heard = await page.evaluate("heard")
            assert {each["origin"] for each in heard} == {own}
            assert heard[-1]["outcome"]["reason"] == "step_limit"
            kinds = {each["type"] for each in heard}
            assert kinds == {"ready", "step", "started", "ended"}
            frame = page.frame_locator("#game")
            await frame.get_by_role("button", name="Continue").click()
            await expect(frame.locator("iframe")).to_be_attached()


async def test_other_sites_get_nothing_from_a_frame(browser: Any, tmp_path: Path) -> None:
    async with site() as lab, site() as evil, serving(tmp_path, page_parents=lab) as server:
        room = server.lobby.create(messages.Create(task=ALONE))
        url = f"http://127.0.0.1:{server.port}/play?embed={evil}&name=x#{room.code}"
        async with survey(browser, evil, url) as page:
            await asyncio.sleep(1)
            assert await page.evaluate("heard") == []
            assert names(room) == [""]
        # The allowed site may frame the page, but the page obeys the named origin only.
        async with survey(browser, lab, url) as page:
            frame = page.frame_locator("#game")
            await expect(frame.locator("#cover")).to_contain_text("Waiting room")
            await page.evaluate("tell('leave')")
            await asyncio.sleep(0.5)
            assert await page.evaluate("heard") == []
            assert names(room) == ["x"]


async def enter_in_firefox(firefox: FirefoxPage, url: str, name: str) -> None:
    # Another fragment alone would load the page a second time, at an unknown moment.
    await firefox.goto("about:blank")
    await firefox.goto(url)
    await firefox.wait_for("document.activeElement.id === 'name'")
    await firefox.press(*name, ENTER)
    await firefox.wait_for('document.activeElement.innerText === "I\'m ready"')
    # The driver's keys do not activate buttons in Firefox.
    await firefox.evaluate("document.activeElement.click()")


@asynccontextmanager
async def behind_caddy(folder: Path) -> AsyncIterator[tuple[Server, str]]:
    """Run a server behind Caddy as the guide configures it; yield it with its HTTPS address."""
    port = free_ports(1)
    async with serving(folder / "recordings", trust_proxy="loopback") as server:
        proxy = PROXIES["caddy"](folder, port, server.port, 1)
        # Caddy's start waits for the answer of the server, which runs in this thread.
        await asyncio.to_thread(proxy.__enter__)
        try:
            yield server, f"https://localhost:{port}/play#"
        finally:
            proxy.__exit__(None, None, None)


def links_of(server: Server, **options: Any) -> tuple[Room, messages.Created]:
    request = messages.Create(task=f"{TOGETHER}@2", tokens=True, **options)
    return open_episode(server.services, Opening(request=request, owner="lab"))


@pytest.mark.skipif(FIREFOX is None, reason="needs Firefox: apt install firefox-esr")
@pytest.mark.skipif(not program("caddy"), reason="needs Caddy: apt install caddy")
async def test_two_browsers_finish_games_from_two_links_alone(browser: Any, tmp_path: Path) -> None:
    async with behind_caddy(tmp_path) as (server, site), firefox_page() as firefox:
        _, created = links_of(server, clock=Clock.LOCKSTEP)
        first, second = (f"{site}{link}" for link in created.links.values())
        await enter_in_firefox(firefox, second, "Ben")
        async with visiting(browser, first, "Ada", ignore_https_errors=True) as ada:
            await get_ready(ada)
            for step, words in enumerate(together(f"{TOGETHER}@2")):
                await at_step(ada, step)
                await firefox.wait_for(f"{TEXT_OF}('#progress').startsWith('{step} of')")
                for player, said in words.items():
                    if player == "robot1":
                        await by_buttons(ada, said)
                    else:
                        await firefox.wait_for(f"{BUTTON_WITH}({said!r})")
                        await firefox.evaluate(f"{BUTTON_WITH}({said!r}).click()")
            await expect(ada.locator("#cover")).to_contain_text("Goal reached")
            await firefox.wait_for(f"{TEXT_OF}('#cover').includes('Goal reached')")
        await play_with_a_bot(browser, server, site, firefox)
    recordings = [read_recording(path) for path in (tmp_path / "recordings").glob("*.rbt")]
    kinds = sorted(sorted(each.participants.values()) for each in recordings)
    assert kinds == [[("Ada", "human"), ("Ben", "human")], [("Ben", "human"), ("Robo", "bot")]]
    for each in recordings:
        assert each.outcome is not None
        assert each.outcome["reason"] == "goal"
        assert min(seat["acted"] for seat in each.outcome["seats"]) > 3, "both took part"
        assert each.verify().ok


async def play_with_a_bot(browser: Any, server: Server, site: str, firefox: FirefoxPage) -> None:
    """Begin a game in Firefox, and reach its goal in Chromium by the same link."""
    room, created = links_of(server, clock=Clock.LOCKSTEP)
    url, token = f"{site}{created.links['robot1']}", created.tokens["robot2"]
    request = SeatRequest(server.url, ("Robo",), token, created.code)
    bot = asyncio.create_task(play_seat(request, BotSetup(BotKind.PLANNER)))
    await enter_in_firefox(firefox, url, "Ben")
    for step in range(3):
        await firefox.wait_for(f"{TEXT_OF}('#progress').startsWith('{step} of')")
        said = helpful(room)
        await firefox.wait_for(f"{BUTTON_WITH}({said!r})")
        await firefox.evaluate(f"{BUTTON_WITH}({said!r}).click()")
    async with visiting(browser, url, "Ben", ignore_https_errors=True) as ben:
        await firefox.wait_for(f"{TEXT_OF}('#cover').includes('another window')")
        assert names(room) == ["Ben", "Robo"]
        step = 3
        while not room.ended:
            await at_step(ben, step)
            await by_buttons(ben, helpful(room))
            step += 1
            while not room.ended and room.step < step:
                await asyncio.sleep(0.02)
        await expect(ben.locator("#cover")).to_contain_text("Goal reached")
    assert (await bot)["reason"] == "goal"


def helpful(room: Room) -> str:
    """Return the words of an action of the person that brings the goal nearer."""
    state = room.episode.state
    return words_of(state, "robot1", policy_maker(BotKind.PLANNER, 0)(state, "robot1").act(state))
