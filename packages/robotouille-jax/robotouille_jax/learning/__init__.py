"""IPPO and MAPPO on the pure engine: a whole training run is one compiled function (docs/train.md).

`robotouille-train` is the command.
"""
