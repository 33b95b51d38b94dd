"""`python -m canipulator`."""

from canipulator.cli import main

main()
