"""Clones from surfaces: parents are kept as they are, and warped smoothly into new grains.

Begin at `surface_style`: what is learned of parents; `clone_maker` makes surfaces of it, `clone_avatars` fits
metaballs to them.
"""
