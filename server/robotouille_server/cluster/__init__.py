"""Several nodes that share all episodes through NATS JetStream (docs/cluster.md).

`bus` is what the nodes need of NATS, `nats_bus` the real one; everything else is independent of
both NATS and sockets.
"""
