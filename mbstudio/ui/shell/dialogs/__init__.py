"""Cards and dialogs of the shell: welcome, guide, preferences, palette, recovery, leaving, about."""
