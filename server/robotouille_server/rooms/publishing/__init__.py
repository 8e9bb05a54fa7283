"""Messages to the participants and spectators of a room."""
