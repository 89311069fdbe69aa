"""``python -m mbstudio`` is the ``mbstudio`` command."""

from mbstudio.cli import main

if __name__ == "__main__":
    main()
