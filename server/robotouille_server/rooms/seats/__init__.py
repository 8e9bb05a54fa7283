"""What a room keeps of its seats: names, how often they change hands, whom a step waits for."""
