"""The wire protocol: `messages` and their `error_codes`, a `codec` for each of the two encodings,
and `states` as messages carry them.

Nothing is imported here: recordings need `states` alone, and the models of all messages take a
while to build.
"""
