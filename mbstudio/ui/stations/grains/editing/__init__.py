"""Correcting grains by hand at station Grains; begin at `grain_editing`."""
