"""The app: menu, games, replays and settings in one window."""
