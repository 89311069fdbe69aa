"""Figures for print, with axes: populations, forms, sweeps, and those of the paper.

Begin at `population_figures`.
"""
