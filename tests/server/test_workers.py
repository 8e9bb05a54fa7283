"""An episode's id and code say which worker has it."""

from __future__ import annotations

import pytest

from robotouille.protocol import messages
from robotouille_server.runtime.workers import ElsewhereError, WorkerSlot, plain_code


@pytest.mark.parametrize(
    "typed",
    ["ABCDE-FGHJK", "abcde fghjk", "  abcdefghjk\n", "abc de\u00a0fgh - jk", "a-b-c-defghjk"],
)
def test_dashes_spaces_and_case_of_a_code_do_not_matter(typed: str) -> None:
    assert plain_code(typed) == "ABCDEFGHJK"


class TestNames:
    def test_a_worker_knows_its_own(self) -> None:
        one = WorkerSlot(index=1, count=3, first_port=9001)
        episode = one.mark_id(0xFFFF_FFFF_FFFF_FFFF)
        assert one.owns(episode)
        assert not WorkerSlot(index=2, count=3).owns(episode)
        one.check_here(episode, episode.upper(), 10)
        assert one.mark_letter("Z") == "B"
        one.check_here("BXXXX-XXXXX", "BXXXXXXXXX", 10)

    def test_and_sends_others_where_they_belong(self) -> None:
        one = WorkerSlot(
            index=1, count=3, first_port=9001, url="wss://kitchen.example.org/w{worker}"
        )
        with pytest.raises(ElsewhereError) as error:
            one.check_here("cxxxx-xxxxx", "CXXXXXXXXX", 10)
        assert error.value.moved(7) == messages.Moved(
            ref=7, episode="cxxxx-xxxxx", port=9003, url="wss://kitchen.example.org/w2"
        )

    def test_with_fewer_workers_than_before_all_recordings_have_an_owner(self) -> None:
        ids = [WorkerSlot(index=i, count=8).mark_id(i * 7919) for i in range(8)]
        for episode in ids:
            assert sum(WorkerSlot(index=i, count=3).owns(episode) for i in range(3)) == 1
            assert WorkerSlot().owns(episode)
