"""MechSys: sphero-polyhedra."""
