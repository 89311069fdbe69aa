"""The stations of the job, one folder for each, from the scan to the export.

A station's folder holds its panel, its work and all that belongs to it alone. Begin at `station` and
`registry`.
"""
