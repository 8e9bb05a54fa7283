"""The game around the games: menu, settings, tutorial, what comes after the end."""
