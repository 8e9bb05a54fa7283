"""The benchmark as tasks of Inspect (`inspect-ai`).

    inspect eval robotouille/synchronous --model anthropic/claude-…

`registry` is what Inspect's entry point loads; nothing else here is imported by the benchmark, and
this imports nothing, so that it works without Inspect.
"""
