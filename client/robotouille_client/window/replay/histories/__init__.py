"""Histories of games, step by step: of a recording, and of a live game that grows."""
