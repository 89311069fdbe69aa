"""The stations of the job, one folder each: from the scan to the export.

A station's folder holds its panel, its work and what belongs to it alone.
"""
