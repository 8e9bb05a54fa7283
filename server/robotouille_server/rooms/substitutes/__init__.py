"""Bots that play for absent participants, and the process in which they decide."""
