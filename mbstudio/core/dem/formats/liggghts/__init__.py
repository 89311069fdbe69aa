"""LIGGGHTS: multisphere templates.

Begin at `target`, which writes the shapes; `deck` and `specimen` make an example that runs.
"""
