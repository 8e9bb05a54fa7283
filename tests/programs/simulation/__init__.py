"""The whole server in a simulated world, in which everything goes wrong.

Nothing of the product is replaced. `robotouille_server.serve`, the client library, the bots and
the `websockets` library run as they are, on an event loop with virtual time, an in-memory network
and an in-memory disk. A seed decides everything: what is played, how good the lines are, and what
an adversary breaks when. The same seed gives the same course, event for event.

    python -m tests.programs.simulation --seeds 0:2000 --jobs 2  # many seeds; failing ones listed
    python -m tests.programs.simulation --seed 1234 --trace      # one again, with every event
    python -m tests.programs.simulation --hours 8                # nightly: one seed after another
    python -m tests.programs.simulation --day                    # 24 hours of one server

| module | what |
| --- | --- |
| `loop` | virtual time; processes whose callbacks can be suspended, counted and killed |
| `network`, `transport`, `frames` | TCP in memory: latency, stalls, resets, half-open |
| `disk` | the server's `Storage`: full disks, torn appends, locks that end with a process |
| `machine` | server processes: crash, restart, hand-over |
| `clients` | people: the client library and bots, each message held against the recordings |
| `oracle` | the recordings, re-simulated byte by byte as they are written: the truth |
| `scenario`, `adversary` | what is played, and what goes wrong |
| `simulation` | a run from its seed to the last check; `day`: a run that does not end so soon |
| `runs`, `__main__` | many seeds in several processes; the command |

What is broken: connections are cut (for one end or both), stalled for milliseconds to a minute in
one direction or both, refused; messages are lost, doubled and reordered (on connections that are
cut soon after); clients are suspended, killed, replaced with the same resume token while the
first still lives, and lose their machine without a word; the server is suspended, killed after
any callback (so at any await), killed in the midst of an append (which is torn) or of closing a
file, and replaced by a new process while it drains; the disk fills up.

What must hold, checked as it happens:

* a client is told nothing that is not recorded; its state at a step is the recorded one;
* its step numbers never go back; whole recorded frames are never cut off: no fork after a crash;
* no action acts twice; one that is said to have applied is recorded in that step;
* what is heard was said once, in this episode, and nothing is missed after a reconnect;
* nobody sees anything of another episode;
* the server's states are those of the recordings, after a restart too;
* once things work again all games end; then no room, session, connection, task or timer is left;
* all recordings are closed and verify; the server logs no unexpected error.

How a process is killed: each handle of the loop has a context, and that names its process. After
the kill none of its handles runs, its transports are dead, its disk refuses it, and its tasks are
kept, so that no `finally` runs before the end of the simulation, when none can reach anything.

A new kind of fault is a method of `Adversary` that returns what it did (empty: nothing), and its
name in `scenario.FAULTS`. A new invariant is best checked in `clients.WatchedClient` or `oracle`.
"""
