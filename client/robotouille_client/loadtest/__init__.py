"""The load tester: bots by the thousand, and a report of what they and the server went through."""
