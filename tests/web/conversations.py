"""Random conversations of a player with a server, as events for two clients at once.

The server is a model: it plays a real kitchen, and continues, forgets or moves the session. The
network loses requests, frames and connections.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from robotouille import GroundAction
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON
from robotouille_client.sansio.client_protocol import ClientProtocol
from robotouille_client.sansio.client_state import ClientState
from robotouille_client.sansio.game_events import ChatReceived, ChatRepeated
from robotouille_client.sansio.game_replica import GameReplica
from tests.support.scripted_server import CODE, ScriptedServer

__all__ = ["CODE", "Conversation"]

URL = "ws://127.0.0.1:8765/"
JOIN = messages.Join(episode=CODE, view="state", ready=False, agent="browser")
EVENTS = {
    "serve": 30, "deliver": 40, "step": 25, "act": 20, "say": 4, "chat": 4, "wait": 6,
    "refuse": 3, "drop": 2, "lose": 4, "forget": 1, "expire": 1, "move": 1, "pause": 2,
}  # fmt: skip
"""Weights of the events."""


class Kitchen(ScriptedServer):
    """Server of one episode: it reads requests, and puts frames on the wire.

    Attributes:
        wire: Frames that have not arrived.
        known: True if the server continues the session of its resume token.
        seated: True if that session is in the episode.
        expired: True if the server refuses its resume token.
        heard: Number of the last chat message that has arrived.
    """

    def __init__(self, rng: random.Random) -> None:
        super().__init__("multi_agent/01")
        self.wire: deque[messages.ServerMessage] = deque()
        self.known = self.seated = self.expired = self.joined_now = False
        self.phase = "running"
        self.heard = 0
        self._rng = rng
        self._deltas: list[messages.Delta] = []
        self._said: list[messages.Said] = []
        self._seq = 0
        self._accepted: tuple[int, GroundAction] | None = None
        self._last: dict[str, Any] = {}

    @property
    def _player(self) -> str:
        return str(self.world.players[0])

    def read(self, request: messages.Message) -> None:
        """Answer a request."""
        match request:
            case messages.Hello():
                self._greet(request)
            case messages.Join() if self.joined_now:
                self.wire.append(self.error("episode/joined", request.ref))
            case messages.Join():
                self.joined_now = self.seated = True
                self.wire.append(self.joined(request.ref, seq=self._seq, said=len(self._said)))
                self.wire.append(self._snapshot())
                self.wire.extend(self._said)
            case messages.Act():
                self._read_act(request)
            case messages.Say():
                self.chat(request.text)
            case messages.Resync():
                self.wire.append(self._snapshot())

    def _greet(self, hello: messages.Hello) -> None:
        if hello.resume and self.expired:
            self.expired = self.known = self.seated = False
            self.wire.append(self.error("auth/expired"))
            return
        resumed = bool(hello.resume) and self.known
        welcome = self.welcome(resumed=resumed)
        self.wire.append(welcome.model_copy(update={"readiness": True}))
        self.known = True
        self.seated = self.joined_now = resumed and self.seated
        if not self.seated:
            return
        self.wire.append(self.joined(seq=self._seq, said=len(self._said)))
        seen = hello.seen
        if seen is None or seen.stale:
            self.wire.append(self._snapshot())
        else:
            self.wire.extend(self._deltas[seen.step :])
        self.wire.extend(self._said[self.heard :])
        self.wire.append(self._roster())

    def _read_act(self, act: messages.Act) -> None:
        assert isinstance(act.action, messages.NamedAction)
        if act.seq > self._seq:
            self._seq = act.seq
            wanted = (act.action.name, tuple(act.action.args))
            actions = self.world.ground_actions(self._player)
            action = next(each for each in actions if (each.name, each.arguments) == wanted)
            self._accepted = (act.seq, action)

    def refuse(self) -> None:
        """Reject the accepted action before its step."""
        if self._accepted is not None:
            (seq, action), self._accepted = self._accepted, None
            self._last = {"last_seq": seq, "last_step": self.step, "last_reasons": ["no"]}
            code = self._rng.choice(("action/turn", "rate/limited"))
            if code == "rate/limited":  # The server has not looked at the action.
                self._seq, self._last = seq - 1, {}
            self._send(
                messages.Rejected(
                    seq=seq, step=self.step, action=str(action), code=code, reasons=["no"]
                )
            )

    def take_step(self) -> None:
        """Advance with the accepted action and one of the other player."""
        other = self._rng.choice([None, *_of_player(self.state.actions(self.world.players[1]))])
        seq, action = self._accepted or (0, None)
        delta = self.delta([each for each in (action, other) if each is not None])
        seqs = [seq if row[0] == 0 else 0 for row in delta.did]
        unmet = next((delta.unmet.get(str(at), []) for at, each in enumerate(seqs) if each), [])
        if action is not None:
            self._last = {"last_seq": seq, "last_step": self.step, "last_reasons": unmet}
        self._accepted = None
        self._deltas.append(delta.model_copy(update={"seq": seqs}))
        self._send(self._deltas[-1])

    def chat(self, text: str) -> None:
        number = len(self._said) + 1
        said = messages.Said(
            number=number, name="Ben", seat=self._player, text=text, step=self.step
        )
        self._said.append(said)
        self._send(said)

    def pause(self) -> None:
        """Pause the episode, or continue it."""
        self.phase = "running" if self.phase == "paused" else "paused"
        self._send(self._roster())

    def finish(self) -> None:
        outcome = {"reason": "goal", "steps": self.step, "seconds": 1.0, "seats": []}
        ended = {"step": self.step, "outcome": outcome, "hash": "0" * 32}
        self._send(messages.Ended.model_validate(ended))

    def _send(self, message: messages.ServerMessage) -> None:
        if self.joined_now:
            self.wire.append(message)

    def _snapshot(self) -> messages.Snapshot:
        return self.snapshot(seq=self._seq, phase=self.phase, **self._last)

    def _roster(self) -> messages.Roster:
        seats = [messages.SeatInfo(player=player, name=player) for player in self.world.players]
        return messages.Roster(phase=self.phase, turn=None, seats=seats)


class Conversation:
    """A conversation of the Python client, which another client can repeat.

    Iterate over it for pairs of an event, and what the Python client sends and knows after it.
    """

    def __init__(self, seed: int, events: int) -> None:
        self._rng = random.Random(seed)
        self._count = events
        self._server = Kitchen(self._rng)
        self._client = ClientProtocol(GameReplica, url=URL, name="Ada", kind="human", rng=self._rng)
        self._client.request(JOIN, 0.0)
        self._requests: deque[messages.Message] = deque()
        self._now = 0.0
        self._joined_at = 0

    def __iter__(self) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
        join = {"type": "join", "episode": CODE, "view": "state", "ready": False}
        start = {"address": URL, "name": "Ada", "join": {**join, "agent": "browser"}}
        yield self._after({"do": "start", **start})
        for _ in range(self._count):
            if not self._client.state.connected:
                self._client.connection_made(self._now)
                yield self._after({"do": "open"})
                continue
            (kind,) = self._rng.choices([*EVENTS], [*EVENTS.values()])
            event = self._draw(kind)
            if event is not None:
                yield self._after(event)
        yield from self._end()

    def _end(self) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
        """Let everything arrive, then end the episode."""
        if not self._client.state.connected:
            self._client.connection_made(self._now)
            yield self._after({"do": "open"})
        ended = False
        while self._requests or self._server.wire or not ended:
            if self._requests:
                self._serve()
            elif self._server.wire:
                yield self._after(self._deliver())
            else:
                ended = True
                self._server.finish()

    def _draw(self, kind: str) -> dict[str, Any] | None:
        """Let an event happen; return it if the clients notice it."""
        server, game = self._server, self._client.game
        match kind:
            case "serve" if self._requests:
                self._serve()
            case "deliver" if server.wire:
                return self._deliver()
            case "step" if server.phase == "running":
                server.take_step()
            case "chat":
                server.chat(f"line {self._rng.random()}")
            case "refuse":
                server.refuse()
            case "pause":
                server.pause()
            case "forget":
                server.known = False
            case "expire":
                server.expired = True
            case "drop" if server.wire and isinstance(server.wire[0], messages.Delta):
                server.wire.popleft()
            # Between `joined` and the first snapshot, Python would repeat its join, in vain.
            case "lose" if self._client.welcomed and self._client.state is not ClientState.SYNCING:
                return self._lose()
            case "move" if self._client.state is ClientState.PLAYING:
                server.wire.clear()
                server.wire.append(server.moved(port=self._rng.choice((9000, 9001))))
            case "act" | "say" | "wait":
                return self._person(kind, game)
        return None

    def _person(self, kind: str, game: GameReplica | None) -> dict[str, Any] | None:
        if game is None:
            return None
        if kind == "wait":
            seconds = self._rng.choice((0.3, 3.0, 6.0))
            self._now += seconds
            timer = self._client.get_timer()
            if timer is not None and timer <= self._now:
                self._client.handle_timer(self._now)
            return {"do": "wait", "seconds": seconds}
        if not game.running or not self._caught_up:
            return None
        if kind == "say":
            text = f"hello {self._rng.random()}"
            game.say(text)
            return {"do": "say", "text": text}
        actions = _of_player(game.actions)
        if not actions:
            return None
        action = self._rng.choice(actions)
        game.propose(action, self._now)
        return {"do": "act", "action": {"name": action.name, "args": [*action.arguments]}}

    @property
    def _caught_up(self) -> bool:
        """True if the steps that a lost connection has missed are here.

        Until then, the page holds new actions back and Python sends them.
        """
        game = self._client.game
        here = game is not None and game.step >= self._joined_at
        return here and self._client.state is ClientState.PLAYING

    def _serve(self) -> None:
        self._server.read(self._requests.popleft())

    def _deliver(self) -> dict[str, Any]:
        message = self._server.wire.popleft()
        self._client.receive(message, self._now)
        if isinstance(message, messages.Joined):
            self._joined_at = message.step
        elif isinstance(message, messages.Said):
            self._server.heard = message.number
        if not self._client.state.connected:
            self._cut()
        return {"do": "frame", "data": JSON.encode(message)}

    def _lose(self) -> dict[str, Any]:
        self._client.connection_lost(self._now)
        self._cut()
        return {"do": "lose"}

    def _cut(self) -> None:
        self._server.wire.clear()
        self._requests.clear()
        self._server.joined_now = False

    def _after(self, event: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return an event with its effects on the Python client."""
        sent = []
        while (message := self._client.next_message()) is not None:
            sent.append(message)
            self._client.message_sent()
        self._requests.extend(sent)
        game = self._client.game
        results = [] if game is None else game.results()
        return event, {
            "sent": sent,
            "answers": [[seq, result.applied, result.code] for seq, result in results],
            "chat": []
            if game is None
            else [
                event.text
                for event in game.poll()
                if isinstance(event, ChatReceived | ChatRepeated)
            ],
            "game": None if game is None else _copy_of(game),
            "url": self._client.url,
        }


def _of_player(actions: Sequence[GroundAction]) -> list[GroundAction]:
    """Return the actions that name their player. The model of the server knows no others."""
    return [action for action in actions if action.player is not None]


def _copy_of(game: GameReplica) -> dict[str, Any]:
    unanswered = next((act.seq for act in game.unanswered), None)
    return {
        "step": game.step, "phase": game.phase, "seq": game._sent.seq,
        "outcome": game.outcome, "unanswered": unanswered,
        "facts": sorted(game.state.fact_names()) if game.has_state else None,
        "seats": [seat.name for seat in game.seats],
    }  # fmt: skip
