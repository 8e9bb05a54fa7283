"""Episodes as rooms: who is in them, what is sent to them, and how they are recorded.

Import from its modules: the process of the substitute bots has one of them, and nothing else.
"""
