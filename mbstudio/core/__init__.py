"""The engine: arrays in, arrays out. Knows neither Qt nor windows.

Its folders are the steps from scan to DEM files. Begin at `scan`, `grains` and `imaging`.
"""
