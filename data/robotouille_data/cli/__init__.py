"""The commands of the catalogue: `robotouille data …`."""
