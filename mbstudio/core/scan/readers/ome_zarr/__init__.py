"""OME-Zarr and plain Zarr: many small files in a folder, or in one archive.

Begin at `reading`. `store` finds the files and never leaves the folder, `nodes` reads what they say,
`multiscale` the voxel size of NGFF, `chunks` the voxels.
"""
