"""MercuryDPM: clumps of spheres.

Begin at `target`, which writes the shapes; `deck` makes an example that runs.
"""
