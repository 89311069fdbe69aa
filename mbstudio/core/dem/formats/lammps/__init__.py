"""LAMMPS: rigid molecules of spheres."""
