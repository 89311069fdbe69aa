"""PFC3D (Itasca): clumps."""
