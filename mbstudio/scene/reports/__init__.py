"""Reports on one HTML page: populations, and the quality of clones.

Begin at `report_page`, which both are built on.
"""
