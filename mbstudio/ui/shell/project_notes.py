"""What is to be known of a project that was read."""

from __future__ import annotations

import warnings
from collections.abc import Callable

from mbstudio.core.errors import ProjectWarning
from mbstudio.core.project import Project


def told_of(read: Callable[[], Project]) -> tuple[Project, tuple[str, ...]]:
    """Return a project, and what the person should know about its file and its journal."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", ProjectWarning)
        project = read()
    return project, tuple(str(one.message) for one in told if issubclass(one.category, ProjectWarning))
