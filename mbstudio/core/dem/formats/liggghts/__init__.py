"""LIGGGHTS: multisphere templates."""
