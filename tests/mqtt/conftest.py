"""Skip the tests of MQTT where its library is not installed."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("aiomqtt") else ["test_*.py"]
