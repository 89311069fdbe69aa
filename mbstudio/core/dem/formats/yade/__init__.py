"""Yade: clumps of spheres and level sets."""
