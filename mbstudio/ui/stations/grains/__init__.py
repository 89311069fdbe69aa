"""Station Grains: find the grains of a scan, look through them."""
