"""Cards and dialogs of the shell: welcome, guide, preferences, palette, recovery, leaving, about.

Each knows only what it shows. Begin at `welcome`, which a new user sees first.
"""
