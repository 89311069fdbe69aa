"""What DEM engines read: one module, or one folder, an engine.

Each ends in a `TARGET` that names its options, and has one line in `mbstudio.core.dem.target`. Begin with
`ply`, the shortest of those that write meshes, then read `peclet`, which writes level sets and a script.
"""
