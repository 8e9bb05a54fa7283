"""Recordings of episodes: writing before publishing, closing, restoring and finding them."""
