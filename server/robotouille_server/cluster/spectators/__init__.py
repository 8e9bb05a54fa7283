"""Spectators of other nodes' episodes: relays at the owner, mirrors at the others."""
