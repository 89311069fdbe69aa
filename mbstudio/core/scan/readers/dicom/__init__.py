"""DICOM: series of slices in a folder, and files of many frames.

Begin at `reading`. `headers` reads what a file says of itself, `frames` its pixels, `series` finds the
slices that belong together and their order.
"""
