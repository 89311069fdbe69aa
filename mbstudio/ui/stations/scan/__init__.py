"""Station Scan: open a stack, state its voxel size."""
