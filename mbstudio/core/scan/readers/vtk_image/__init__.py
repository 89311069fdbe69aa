"""VTK image data (.vti), parsed here: VTK trusts what a file says, and a damaged one ends the process.

Begin at `reading`. `layout` finds the arrays in the XML, `contents` their numbers.
"""
