"""Skip the tests of clusters where the library of NATS is not installed."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("nats") else ["test_*.py"]
