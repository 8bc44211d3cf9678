"""`python -m lithoform` is the command `lithoform`."""

from lithoform.cli import main

main()
