"""The panel beside the kitchen: ticket or orders, the clock, seats and chat."""
