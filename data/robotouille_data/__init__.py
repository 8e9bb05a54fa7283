"""A catalogue of recordings: episodes, seats, steps and events as tables of a database.

Everything in it is derived from recordings, and rebuilt from nothing with the same rows.
"""
