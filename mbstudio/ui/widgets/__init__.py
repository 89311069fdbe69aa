"""Widgets that several stations share: forms, plots, tables, sliders.

They know no station and no project. Begin at `forms`.
"""
