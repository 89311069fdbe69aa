"""``python -m mbstudio``: the command line."""

from mbstudio.cli import main

main()
