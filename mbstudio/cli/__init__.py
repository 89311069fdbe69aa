"""The command line: the same steps as in the window and in Python."""

from mbstudio.cli.app import main

__all__ = ["main"]
