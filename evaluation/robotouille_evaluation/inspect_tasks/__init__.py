"""The benchmark as Inspect tasks (`inspect-ai`).

    inspect eval robotouille/synchronous --model anthropic/claude-…

Inspect's entry point loads `registry`. Nothing else imports this package, and this module imports
nothing, so the benchmark works without Inspect.
"""
