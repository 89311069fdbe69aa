"""The project: its state, its file and its history.

Begin at :class:`~mbstudio.core.project.project.Project`; `file` holds the format.
"""

from mbstudio.core.project.autosave import Autosave, AutosaveNote
from mbstudio.core.project.history import History
from mbstudio.core.project.project import Project
from mbstudio.core.project.state import FitSettings, ProjectState, ScanReference

__all__ = ["Autosave", "AutosaveNote", "FitSettings", "History", "Project", "ProjectState", "ScanReference"]
