"""Chrono DEM-Engine (Zhang et al.): clumps.

Begin at `target`, which writes the shapes; `deck` makes an example that runs.
"""
