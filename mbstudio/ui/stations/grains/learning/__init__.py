"""Telling grain from void at station Grains: previews in the slices, and strokes to learn from.

Begin at `slice_preview`, which shows what a threshold, a classifier or the splitting would give;
`stroke_painting` takes the strokes and learns from them.
"""
