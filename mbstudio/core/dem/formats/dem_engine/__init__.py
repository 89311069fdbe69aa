"""Chrono DEM-Engine (Zhang et al.): clumps."""
