"""Sources of the views that a window shows: games on a server and games in this process.

Sources do not draw. They receive the clock as a function, so tests can control time.
"""
