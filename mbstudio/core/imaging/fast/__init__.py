"""The fast method: Levenberg-Marquardt on surface points, relocations, repair of wrong handles and holes.

Begin at `fast`, the step object; `refine` holds the search at the end.
"""
