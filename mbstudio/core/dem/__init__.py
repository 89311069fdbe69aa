"""Export of avatars to DEM engines, one module a target behind one registry."""
