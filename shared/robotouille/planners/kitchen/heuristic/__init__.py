"""A lower bound of the steps to the goal of a kitchen, and its parts."""
