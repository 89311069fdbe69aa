"""Lengths with their unit: nothing in mbstudio carries a bare number for a length.

Volumes are indexed ``[z, y, x]``; points are ``(x, y, z)``. The centre of voxel
``[iz, iy, ix]`` lies at ``origin + (ix * dx, iy * dy, iz * dz)``.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import UnitError

METRES_PER_UNIT = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}

_UNIT_ALIASES = {
    "µm": "um", "μm": "um", "µ": "um", "μ": "um", "micron": "um", "microns": "um", "micro-m": "um",
    "mu": "um", "micrometer": "um", "micrometre": "um", "micrometers": "um", "micrometres": "um",
    "mikrometer": "um", "um": "um", "nm": "nm", "cm": "cm",
    "nanometer": "nm", "nanometre": "nm", "nanometers": "nm", "nanometres": "nm",
    "millimeter": "mm", "millimetre": "mm", "millimeters": "mm", "millimetres": "mm",
    "centimeter": "cm", "centimetre": "cm", "centimeters": "cm", "centimetres": "cm",
    "meter": "m", "metre": "m", "meters": "m", "metres": "m",
}  # fmt: skip

# Words that stand where a unit should, and name none.
_NO_LENGTHS = ("", "pixel", "pixels", "px", "voxel", "voxels", "vx", "unit", "units", "none", "null", "???")
# Texts that were written in one of these and read as Latin-1 ("Âµm", "Î¼m", "æm").
_CODECS = ("utf-8", "cp437", "mac-roman", "gbk", "shift-jis")

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LENGTHS = re.compile(rf"^\s*(?P<numbers>{_NUMBER}(?:\s*[x×,;\s]\s*{_NUMBER})*)\s*(?P<unit>[^\d\s]*)\s*$")


def parse_unit(text: str) -> str:
    """Return the canonical name (``nm``, ``um``, ``mm``, ``cm``, ``m``) of a length unit.

    Raises
    ------
    UnitError
        If the unit is not a known length unit.
    """
    name = _plain_unit(text)
    name = _UNIT_ALIASES.get(name.lower(), name)
    if name == "MM":
        name = "mm"
    if name not in METRES_PER_UNIT:
        known = ", ".join(METRES_PER_UNIT)
        raise UnitError(f"'{text}' is not a known length unit: use one of {known}.")
    return name


def _plain_unit(text: str) -> str:
    r"""Return a unit's text without the traces of the file that it was written in.

    Quotes and brackets around it go, escapes (``\u00B5m``, ``&micro;m``) become characters, and
    a micro sign that was read in another encoding than it was written in becomes one again.
    """
    name = html.unescape(str(text).strip("\x00 \t\r\n"))
    name = re.sub(r"\\+u([0-9a-fA-F]{4})", lambda code: chr(int(code[1], 16)), name)
    name = re.sub(r"\\+x([0-9a-fA-F]{2})", lambda code: chr(int(code[1], 16)), name)
    name = name.strip("\"'`()[]<> \t").removesuffix("^1").removesuffix(".")
    if name.isascii() or name.lower() in _UNIT_ALIASES:
        return name
    for western in ("latin-1", "cp1252"):
        for codec in _CODECS:
            try:
                meant = name.encode(western).decode(codec)
            except UnicodeError:
                continue
            if meant.lower() in _UNIT_ALIASES:
                return meant
    return name


def names_no_length(text: str) -> bool:
    """Return whether a unit's text says nothing about lengths: empty, or pixels."""
    return _plain_unit(text).lower() in _NO_LENGTHS


def conversion_factor(source: str, target: str) -> float:
    """Return the number of `target` units in one `source` unit (mm to um: 1000)."""
    return METRES_PER_UNIT[parse_unit(source)] / METRES_PER_UNIT[parse_unit(target)]


def unit_label(unit: str) -> str:
    """Return the unit as people write it (``um`` becomes ``µm``)."""
    return "µm" if unit == "um" else unit


@dataclass(frozen=True)
class VoxelSize:
    """Edge lengths of a voxel, in the order of the array's axes.

    Attributes
    ----------
    z, y, x : float
        Edge lengths in `unit`, each finite and positive.
    unit : str
        Canonical length unit.

    Raises
    ------
    UnitError
        If an edge is not a positive finite number or the unit is unknown.
    """

    z: float
    y: float
    x: float
    unit: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", parse_unit(self.unit))
        for axis in ("z", "y", "x"):
            edge = float(getattr(self, axis))
            if not math.isfinite(edge) or edge <= 0:
                raise UnitError(
                    f"A voxel size of {edge:g} {self.unit} along {axis} is impossible: "
                    "give a positive length such as '14 um'."
                )
            object.__setattr__(self, axis, edge)

    @classmethod
    def parse(cls, size: str | float | Sequence[float] | VoxelSize, unit: str | None = None) -> VoxelSize:
        """Read a voxel size: ``"14 um"``, ``"20 x 14 x 14 um"`` (z, y, x), or numbers with `unit`.

        Raises
        ------
        UnitError
            If the text is not one or three lengths, or no unit is given.
        """
        if isinstance(size, VoxelSize):
            return size
        if isinstance(size, str):
            match = _LENGTHS.match(size)
            if match is None:
                raise UnitError(
                    f"Cannot read the voxel size '{size}': "
                    "write it as '14 um' or '20 x 14 x 14 um' (z, y, x)."
                )
            edges = [float(number) for number in re.findall(_NUMBER, match["numbers"])]
            unit = match["unit"] or unit
        else:
            edges = [float(edge) for edge in np.atleast_1d(np.asarray(size, dtype=float))]
        if not unit:
            raise UnitError(f"The voxel size '{size}' has no unit: write for example '14 um'.")
        if len(edges) == 1:
            edges = edges * 3
        if len(edges) != 3:
            raise UnitError(
                f"The voxel size '{size}' has {len(edges)} values: give one, or three in the order z, y, x."
            )
        z, y, x = edges
        return cls(z, y, x, unit)

    @property
    def zyx(self) -> tuple[float, float, float]:
        return (self.z, self.y, self.x)

    @property
    def xyz(self) -> tuple[float, float, float]:
        return (self.x, self.y, self.z)

    @property
    def volume(self) -> float:
        """Volume of one voxel in unit**3."""
        return self.z * self.y * self.x

    @property
    def is_isotropic(self) -> bool:
        return max(self.zyx) <= min(self.zyx) * (1 + 1e-6)

    def to(self, unit: str) -> VoxelSize:
        """Return the same size in another unit."""
        factor = conversion_factor(self.unit, unit)
        return VoxelSize(self.z * factor, self.y * factor, self.x * factor, unit)

    def positions(
        self, indices: Float[np.ndarray, "m 3"], origin: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Float[np.ndarray, "m 3"]:
        """Return the points (x, y, z) in `unit` of (possibly fractional) indices [z, y, x]."""
        points: np.ndarray = np.asarray(indices, dtype=float)[:, ::-1] * self.xyz + np.asarray(
            origin, dtype=float
        )
        return points

    def __str__(self) -> str:
        if self.is_isotropic:
            return f"{self.x:g} {unit_label(self.unit)}"
        return f"{self.z:g} x {self.y:g} x {self.x:g} {unit_label(self.unit)} (z, y, x)"
