"""Kratos DEM: clusters of spheres."""
