"""Drill: episodes of bots and of people's windows on a real server that is killed repeatedly.

`python -m tests.programs.drill` runs it. `server` contains the process that is killed, and
`moments` the times. `players` runs bots in separate processes, `people` runs windows. `witness`
records what each client receives, and `verdict` compares it with the recordings.
"""
