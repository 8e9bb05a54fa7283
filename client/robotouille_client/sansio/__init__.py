"""The client side of the protocol without I/O: state machine, copy of the episode, addresses."""
