"""The pygame window: everything that draws or reads a mouse."""
