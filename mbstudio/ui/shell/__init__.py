"""The window around the stations: rail, docks, menus, history, files, messages, preferences.

Begin at `app`, which opens `main_window`.
"""
