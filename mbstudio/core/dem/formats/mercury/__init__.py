"""MercuryDPM: clumps of spheres."""
