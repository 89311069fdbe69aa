"""The window: a shell around stations, and the view in the middle.

Everything reaches for a `Studio` in place of the window itself. Begin at `studio`, then at
`stations/station.py`.
"""
