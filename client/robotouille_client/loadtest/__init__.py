"""The load tester: thousands of bots, and a report of how the server performed."""
