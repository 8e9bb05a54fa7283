"""Simulation of the whole server in a world in which everything can fail.

The simulation replaces nothing of the product. `robotouille_server.serve`, the client library, the
bots and the `websockets` library run unchanged, on an event loop with virtual time, an in-memory
network and an in-memory disk. A seed determines everything: the episodes, the quality of the
connections, and the faults. The same seed gives the same course, event for event.

    python -m tests.programs.simulation --seeds 0:2000 --jobs 2  # many seeds; lists the failures
    python -m tests.programs.simulation --seed 1234 --trace      # one seed, with every event
    python -m tests.programs.simulation --hours 8                # nightly: seeds until time is up
    python -m tests.programs.simulation --day                    # 24 hours of one server
    python -m tests.programs.simulation.cluster --seeds 0:1000   # three nodes of a cluster

| module | content |
| --- | --- |
| `loop` | virtual time, and processes whose callbacks can be suspended, counted and killed |
| `network`, `transport`, `frames` | TCP in memory: latency, stalls, resets, half-open connections |
| `disk` | the server's `Storage`: full disks, torn appends, locks that end with their process |
| `machine` | server processes: crash, restart, hand-over |
| `clients` | participants: the client library and bots, with every message checked |
| `oracle` | the recordings, simulated again byte by byte while they are written |
| `scenario`, `adversary` | the episodes and the faults |
| `simulation`, `day` | a run from its seed to the last check; a long run |
| `runs`, `__main__` | many seeds in several processes; the command |
| `cluster` | three nodes on a simulated NATS, with faults and invariants of their own |
| `cluster_nodes`, `cluster_games`, `cluster_oracle` | its processes, its players, its checks |

Faults:

* Connections are cut for one end or both, refused, or stalled for milliseconds up to a minute.
* Messages are lost, duplicated and reordered, on connections that are cut soon afterwards.
* Clients are suspended, killed, lose their machine without a packet, or are replaced with the same
  resume token while the first one still lives.
* The server is suspended, killed after any callback (so at any await), killed during an append
  (which is then torn) or while closing a file, and replaced by a new process while it drains.
* The disk fills up.

Invariants, checked as the run proceeds:

* A client receives nothing that is not recorded. Its state at a step is the recorded one.
* A client's step numbers never decrease, and whole recorded frames are never cut off. A crash
  therefore causes no fork.
* No action applies twice. An action reported as applied is recorded in that step.
* Each received chat message was sent once, in this episode. No message is missing after a
  reconnect.
* No client sees anything of another episode.
* The server's states match the recordings, also after a restart.
* When faults stop, all episodes end. Then no room, session, connection, task or timer is left.
* All recordings are closed and verify. The server logs no unexpected error.

To kill a process, the simulation uses contexts: each handle of the loop has a context, which names
To kill a process, the simulation uses contexts: each handle of the loop has a context, which names
its process. After the kill, none of its handles runs, its transports are dead, and the disk refuses
its calls. Its tasks are kept, so that no `finally` block runs before the end of the simulation,
when it can no longer reach anything.
To add a kind of fault, write a method of `Adversary` that returns a description of what it did
(empty for nothing), and add its name to `scenario.FAULTS`. To add an invariant, check it in
`clients.WatchedClient` or `oracle`.
"""
