"""Yade: clumps of spheres and level sets.

Begin at `target` (clumps) and `level_set`; `script` holds what both let Yade run.
"""
