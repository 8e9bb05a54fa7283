"""The kitchen: room, stations, objects, players, their movements, and signs over them."""
