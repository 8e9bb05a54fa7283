"""The published benchmark: a user's checkout of its repository, and a generator like its own."""
