"""Kernels run as plain Python in tests, which are over before they would be compiled; the tests
of the compiled ones start processes of their own."""

import os

os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
