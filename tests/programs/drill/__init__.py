"""A drill: games of bots and people's windows on a real server that is killed again and again.

`python -m tests.programs.drill` runs it; `server` has the process that is killed, `moments` says
when, `players` plays in processes of their own, `people` at windows, `witness` writes down what a
client is told, and `verdict` holds the recordings against it.
"""
