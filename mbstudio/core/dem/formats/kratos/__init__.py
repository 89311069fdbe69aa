"""Kratos DEM: clusters of spheres.

Begin at `target`, which writes the shapes; `case` makes an example that runs.
"""
