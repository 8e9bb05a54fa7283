"""Bots that play for absent participants, and the processes in which they search."""
