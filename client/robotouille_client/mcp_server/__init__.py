"""`robotouille-mcp`: episodes for agents that speak the Model Context Protocol."""
