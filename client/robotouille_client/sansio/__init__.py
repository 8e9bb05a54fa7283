"""A client without I/O: its protocol, its copy of an episode, addresses and delays."""
