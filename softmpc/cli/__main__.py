"""`python -m softmpc.cli` is the command `softmpc`."""

from softmpc.cli.main import main

main()
