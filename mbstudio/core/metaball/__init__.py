"""Avatars: the metaball function, its surface, mass properties and validity.

Begin at :class:`~mbstudio.core.metaball.avatar.Avatar`. `torch_field` has the same geometry on torch tensors,
differentiable and on any device; it is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mbstudio.core.metaball.avatar import Avatar

if TYPE_CHECKING:
    from mbstudio.core.metaball import torch_field

__all__ = ["Avatar", "torch_field"]


def __getattr__(name: str) -> Any:
    if name == "torch_field":
        return import_module("mbstudio.core.metaball.torch_field")
    raise AttributeError(f"module 'mbstudio.core.metaball' has no attribute {name!r}")
