"""Packings: grains poured into a mould, settled by an engine in a process of its own, and measured.

`packer` has an engine settle grains, `packing` is what comes of it; `solids` and `contacts` measure it on the
real bodies and on the clumps at rest, `comparing` tells whether two kinds of grains pack alike. Begin at
:func:`~mbstudio.core.packing.packer.pack`.
"""

from mbstudio.core.packing.packer import pack
from mbstudio.core.packing.packing import Packing

__all__ = ["Packing", "pack"]
