"""The errors that mbstudio raises on purpose.

Every message names the file or the value at fault and what to do about it; the command
line prints it and the window shows it in the message bar, without a traceback.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

_BREAKS = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")


class MbstudioError(Exception):
    """Base of every error with a message meant for the user: one line, whatever a file put into it."""

    def __str__(self) -> str:
        return _BREAKS.sub(" ", super().__str__())


class Cancelled(MbstudioError):
    """Work that the user stopped. Raised from a progress callback, it ends the work at once."""


class UnitError(MbstudioError):
    """A length, unit or voxel size that cannot be understood, or is missing."""


class ScanError(MbstudioError):
    """A scan that cannot be read or holds no usable voxels."""


class SeveralArraysError(ScanError):
    """A file that holds several arrays, of which it is not said which one is meant.

    Attributes
    ----------
    path : Path
        The file.
    names : tuple of str
        What may stand behind a colon to name one.
    """

    def __init__(self, message: str, path: Path, names: Sequence[str]) -> None:
        super().__init__(message)
        self.path, self.names = path, tuple(names)


class ScanWarning(UserWarning):
    """Something about a scan's file was taken for granted, and the user should know."""


class SegmentationError(MbstudioError):
    """A scan in which no grains can be found, or a label image that does not fit it."""


class GrainError(MbstudioError):
    """A mask that is not one grain."""


class EditError(GrainError):
    """A correction of grains by hand that cannot be made."""


class ClassifierError(SegmentationError):
    """Strokes that teach nothing, or a classifier that cannot be read or does not fit a scan."""


class GrainWarning(UserWarning):
    """Something about a grain was repaired, and the user should know."""


class SegmentationWarning(UserWarning):
    """Grains were found, but the user should know something about how."""


class MeshError(MbstudioError):
    """A surface mesh that is not a closed body."""


class AvatarError(MbstudioError):
    """Control points or weights that make no metaball."""


class FitError(MbstudioError):
    """A fit that cannot be started or finished as requested."""


class TwinError(FitError):
    """A scan whose grey values avatars cannot be fitted to."""


class SerializationError(MbstudioError):
    """Bodies that cannot be brought into one common frame and order of control points."""


class SerializationWarning(UserWarning):
    """Bodies were serialized, but the user should know something about them."""


class StyleError(MbstudioError):
    """A style-learner that cannot be trained, read or written as requested."""


class StyleWarning(UserWarning):
    """A style-learner could be opened, but the user should know something about its files."""


class GenerationError(MbstudioError):
    """New grains that cannot be generated from these parents."""


class CloningError(MbstudioError):
    """Parents that no clones can be made of, or clones that these parents cannot give."""


class MeasureError(MbstudioError):
    """A body whose shape factors are not defined."""


class ExportError(MbstudioError):
    """DEM files that cannot be written, or would be misread by the engine."""


class PackingError(MbstudioError):
    """Grains that cannot be packed, a packing that is no good, or poses of other grains."""


class ProjectError(MbstudioError):
    """A project file that cannot be read or written."""


class DamagedProjectError(ProjectError):
    """A file that is not what mbstudio wrote; nothing of it was read."""


class ProjectLockedError(ProjectError):
    """A project file that another program works on."""


class ProjectChangedError(ProjectError):
    """A project file that is no longer what was opened: saving would lose what others have written."""


class JournalError(ProjectError):
    """A journal of finished grains that cannot be read or written."""


class ProjectWarning(UserWarning):
    """A project could be opened, but the user should know something about its file."""
