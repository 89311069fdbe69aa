"""What is told of kept grains: how many belong elsewhere, what was kept, what could not be made."""

from __future__ import annotations

from mbstudio.ui.language import tr


def others_told(count: int) -> str:
    """Return what is told of kept grains of another style-learner."""
    if count == 1:
        return tr(
            "One kept grain belongs to another style-learner; "
            "the project keeps them until that is opened again."
        )
    return tr(
        "{count} kept grains belong to another style-learner; "
        "the project keeps them until that is opened again.",
        count=count,
    )


def few_told(made: int, wanted: int) -> str:
    """Return what is told where not all variations are valid."""
    return tr(
        "Only {made} of {wanted} variations are valid bodies: take less noise, or begin with a valid grain.",
        made=made,
        wanted=wanted,
    )


def keep_told(name: str, count: int, first: int) -> str:
    """Return the history's title for grains that were kept, numbered from `first` on."""
    if count == 1:
        return tr("Keep {name}", name=name)
    return tr("Keep {count} variations from {first}", count=count, first=first)
