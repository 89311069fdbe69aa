"""Correcting grains by hand: merge, split, delete, exclude, paint, reshape.

Begin at :class:`~mbstudio.core.grains.editing.editable.EditableGrains`, which every grain set is. An edit is
a record (`records`) that is made on a `workbench`; `joining`, `parting`, `brush`, `reshaping` and `new_grain`
say how, and `replay` makes edits again on other grains. `label_volume` keeps many versions of the labels.
"""

from mbstudio.core.grains.editing.editable import EditableGrains, EditOutcome
from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.grains.editing.records import Edit, read_edit
from mbstudio.core.grains.editing.replay import Replay, replay

__all__ = ["Edit", "EditOutcome", "EditableGrains", "LabelVolume", "Replay", "read_edit", "replay"]
