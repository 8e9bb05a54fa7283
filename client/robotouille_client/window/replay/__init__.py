"""Replay viewer: recordings and watched games, with a timeline below the kitchen.

A `History` holds what happened in each step. The timeline strip draws it and takes clicks. The
viewer puts history, timeline and window together.
"""
