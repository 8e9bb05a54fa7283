"""Requests without an answer, and what becomes of them."""

from __future__ import annotations

from robotouille.protocol import messages
from robotouille_client.errors import ConnectionFailedError
from robotouille_client.sansio.client_requests import RequestDone, RequestFailed, Requests


def test_each_request_has_a_number_of_its_own() -> None:
    requests = Requests()
    first, _ = requests.add(messages.ListEpisodes(), 0.0)
    second, join = requests.add(messages.Join(episode="x"), 0.0)
    assert first != second
    assert join == messages.Join(ref=second, episode="x")
    assert requests.join() == second
    assert requests.find(messages.Left(ref=first, episode="x")) is requests.pending[first]
    assert requests.find(messages.Say(text="no request")) is None


def test_what_becomes_of_a_request_is_told_once() -> None:
    requests = Requests()
    first, _ = requests.add(messages.ListEpisodes(), 0.0)
    second, leave = requests.add(messages.Leave(), 0.0)
    error = ConnectionFailedError("gone")
    requests.fail(first, error)
    left = messages.Left(ref=second, episode="x")
    assert requests.done(second, left) == leave
    assert requests.events() == [RequestFailed(first, error), RequestDone(second, left)]
    assert requests.events() == []


def test_those_that_are_due_are_told() -> None:
    requests = Requests()
    ref, request = requests.add(messages.ListEpisodes(), 1.0)
    requests.pending[ref].again_at = 2.0
    assert requests.timers() == [16.0, 2.0]
    assert requests.to_repeat(1.9) == []
    assert requests.to_repeat(2.0) == [request]
    assert requests.to_repeat(3.0) == []
    assert requests.overdue(15.9) == []
    assert requests.overdue(16.0) == [(ref, requests.pending[ref])]
