"""`python -m robotouille_server` is `robotouille-server`."""

from robotouille_server.cli import main

main()
