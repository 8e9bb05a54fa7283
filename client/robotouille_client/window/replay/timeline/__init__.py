"""The timeline below the kitchen: lanes, legend, buttons and the curve of steps to go."""
