"""`python -m rastercov`: the command, where its script is not on the path."""

from rastercov.cli import main

main()
