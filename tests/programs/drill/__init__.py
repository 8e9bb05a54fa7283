"""Drill: episodes of bots, windows and browsers on a real server that is killed repeatedly.

`python -m tests.programs.drill` runs it. `server` contains the process that is killed, and
`moments` the times. `players` runs bots in separate processes, `people` runs windows, and
`pages` runs browsers, to which accidents happen. `witness` and `page_witness` record what each
client receives, and `verdict` compares it with the recordings.
"""
