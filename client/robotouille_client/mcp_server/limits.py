"""Limits of `robotouille-mcp`: for each token, address and game, and for all together."""

from __future__ import annotations

MAX_BODY_BYTES = 65_536
MAX_BODY_VALUES = 2000
"""Maximum number of values in a request. The library spends a microsecond or more on each."""
MAX_CONNECTIONS = 512
MAX_CONNECTIONS_OF_ADDRESS = 64
REQUEST_SECONDS = 10.0
"""Time limit for the head of a request, and for its body."""

MAX_SESSIONS = 256
MAX_SESSIONS_OF_TOKEN = 32
MAX_SESSIONS_OF_ADDRESS = 64

MAX_REQUESTS_OF_TOKEN = 64
"""Requests of a token in progress. Calls of the tool `wait` take a minute each and would otherwise
use up the connections of all."""
MAX_NEWCOMERS = 448
"""Requests with unknown tokens in progress. The other connections are for known tokens."""
MAX_VISITS_OF_TOKEN = 32
"""Connections that wait for the game server, to join or for one request."""
MAX_GAMES_OF_TOKEN = 16
MAX_CALLS_OF_GAME = 4
"""Calls of a game in progress. They go on when their client closes its connection."""
