"""Floods of a server by hostile clients, brokers and agents, and their effect on an honest game.

* `table` lists all floods, and `measure` runs one against its own server.
* Each other module is a kind of attacker, or the honest user who measures the effect.
"""
