"""Several nodes that share all episodes through NATS JetStream (docs/cluster.md).

`bus` is what the nodes need of NATS, and `nats` has the real one. `node` is one node, `service`
answers requests of clients and other nodes, and `joining` connects both with a server. The episodes
and their journals are in `episodes`, shared secrets in `keys`, spectators of other nodes' episodes
in `spectators`.
"""
