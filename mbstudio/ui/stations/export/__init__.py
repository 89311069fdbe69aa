"""Station Export: files for DEM engines, with preview and specimen."""
