"""Station Fit: avatars of grains, sweeps over the number of control points.

`work` fits, `sweep_work` sweeps, `panel` and the docks show. Begin at `station`.
"""
