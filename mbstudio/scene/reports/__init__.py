"""Reports on one HTML page: populations, and the quality of clones."""
