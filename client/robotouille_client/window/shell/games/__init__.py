"""What is played: here, on a server, and to learn it."""
