"""What a lobby knows of its rooms: how they are listed, and which can be played again."""
