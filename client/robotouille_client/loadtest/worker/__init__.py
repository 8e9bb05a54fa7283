"""One process of the load tester, and the bots in it."""
