"""The panel next to the kitchen: ticket or orders, the clock, seats and chat."""
