"""HDF5 and NeXus.

Begin at `volume`, which finds the scan in a file. HDF5 itself runs in a process of its own: `server` is its
program, `served_file` starts and asks it.
"""
