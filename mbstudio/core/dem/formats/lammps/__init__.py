"""LAMMPS: rigid molecules of spheres.

Begin at `target`, which writes the shapes; `deck` and `specimen` make an example that runs.
"""
