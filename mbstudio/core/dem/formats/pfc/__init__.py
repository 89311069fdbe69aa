"""PFC3D (Itasca): clumps.

Begin at `target`, which writes the shapes; `deck` makes an example that runs.
"""
