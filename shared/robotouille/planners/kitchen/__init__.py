"""Shortest plans for kitchens, with proof: a compact model, an admissible heuristic, A*.

A kitchen is a world whose actions do what a kitchen's do. It is searched as a small record of
integers instead of a set of facts. To read, in this order:

`recognition`         which domains are kitchens, and which of their actions does what
`compact_state`       what a kitchen, a goal, a state and an action are for the search
`model`               from a world to the `Kitchen`
`encode`              from a state of the world to a `CompactState`
`goal_assignments`    from the world's goal to `Goal`s: one for each choice of objects
`applicable`          what can be done in a state
`transitions`         what becomes of it
`heuristic/`          a lower bound of the steps that are left
`search/`             A* and greedy search
`decode`              from a path of the search to a plan of the world
`solver`              when to search how, within limits: the planner
`anytime_search`      a plan at once, then better ones: for play
`plugin`              what other packages find
`kernels`             how all this is compiled, if numba is there, and runs without

In kernels `o` is an object, `p` a player, `m` a meal, `q` a process and `c` a class of stations.
Each part is held against the world: tests compare every transition with the world's, heuristics and
lengths of plans with exhaustive search, compiled answers with those of plain Python.
"""
