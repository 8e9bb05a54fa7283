"""What a lobby knows of its rooms: how one is set up, listed, and played again."""
