"""Rooms: episodes on a server, with their participants, messages and recordings.

Import from the modules: the process of the substitutes needs only one of them.
"""
