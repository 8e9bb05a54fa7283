"""Search over compact states, on arrays that only grow.

`nodes` has the nodes, `one_player` and `team` say what follows on one, `astar` expands them.
"""
