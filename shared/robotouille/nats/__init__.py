"""NATS servers: their addresses, and a client that bounds what it reads. It needs `nats-py`."""
