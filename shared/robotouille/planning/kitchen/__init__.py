"""Shortest plans for kitchens, with proof.

A kitchen is a world whose actions do what a kitchen's actions do. The planner searches small
records of integers instead of sets of facts. To read, in this order:

`recognition`         which domains are kitchens, and which of their actions does what
`compact_state`       kitchens, goals, states and actions as integers
`model`               from a world to a `Kitchen`
`encoding`            from a world's state to a `CompactState`, and from a path to a plan
`goal_assignments`    from a world's goal to `GoalSpec`s: one for each choice of objects
`applicable`          useful actions in a state
`transitions`         effects of actions and of time
`bound`               the admissible heuristic; `bound.lower_bound` has a worked example
`nodes`, `search`     A* and greedy search
`solver`              the optimal planner, within limits
`plugin`              the interface to other packages, and the anytime search
`kernels`             compilation with numba, and plain Python without it

In kernels `o` is an object, `p` a player, `m` a meal, `q` a process and `c` a class of stations.
Tests compare every transition with the world's, the heuristic and plan lengths with exhaustive
search, and compiled results with those of plain Python. See docs/decisions/0010-kitchen-planner.md.
"""
