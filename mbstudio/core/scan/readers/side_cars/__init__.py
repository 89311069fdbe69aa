"""Files beside bare voxels that describe them, and names of files that do.

Begin at `beside`, which finds the side-car of a file; `layout` is what each of them says.
"""
