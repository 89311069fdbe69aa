"""Station Fit: avatars of grains, sweeps over the number of control points."""
