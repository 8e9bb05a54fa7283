"""All of this needs the extra `rl`: without it nothing here is collected."""

from importlib.util import find_spec

if find_spec("gymnasium") is None or find_spec("pettingzoo") is None:
    collect_ignore_glob = ["test_*.py"]
