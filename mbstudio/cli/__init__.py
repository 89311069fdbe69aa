"""The command line: the same steps as in the window and in Python, one module a command.

Begin at `app`, which lists the commands; `inputs` holds the options that several share.
"""

from mbstudio.cli.app import main

__all__ = ["main"]
