"""Whether the files of a domain agree with one another."""
