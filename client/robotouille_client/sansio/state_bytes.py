"""Memory that a client's copy of a state takes.

A delta of 60 bytes makes a new state, whose timers and orders are copied even if only one of them
has changed. A hostile server could therefore fill the memory with states from small messages.
"""

from __future__ import annotations

from robotouille.world.world import State

STATE_BYTES = 400
"""Size of an event with a state and what happened in its step, without the parts below."""
TIMER_BYTES = 100
"""Size of an active effect with its counters, or of a busy player."""
ORDER_BYTES = 150


def state_bytes(state: State) -> int:
    """Return about how many bytes of memory a state takes."""
    size = STATE_BYTES + state.facts.bit_length() // 8
    timers = state.timers
    if timers.pending:
        size += TIMER_BYTES * (len(timers.entries) + len(timers.busy))
    if state.orders is not None:
        size += ORDER_BYTES * len(state.orders.open)
    return size
