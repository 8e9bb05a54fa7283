"""Where the views that a window shows come from: a server, a game in this process, a recording.

None of these draws; time is passed in as a function.
"""
