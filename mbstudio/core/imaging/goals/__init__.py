"""How near an avatar is to its grain, and the search for the number of control points that a goal needs.

Begin at :class:`~mbstudio.core.imaging.goals.fit_goal.FitGoal` and `likeness`.
"""
