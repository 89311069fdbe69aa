"""The table of shape factors: what each is called, how it is found, and what it means.

Measuring, quick factors, meanings of the latent space, the command line, tables, plots and tool tips read
it. A further factor is one entry: ``FACTORS.add(Factor(...))``, or a line in `FACTORS` below.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

from mbstudio.core import formulas
from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.translation import mark
from mbstudio.core.units import unit_label

BANDS = 12
"""Highest band of spherical harmonics."""

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True, kw_only=True)
class Factor:
    """One shape factor.

    Attributes
    ----------
    name : str
        In records, tables and commands.
    title : str
        In words, with a capital.
    meaning : str
        What it is, for a tool tip.
    aliases : tuple of str
        Further names that goals and conditions may call it by.
    symbol : str
        As in docs/shape-factors.md; empty where the field has none.
    formula : str
        In symbols, without words; empty where there is none.
    power : int
        Of a length: 3 for a volume, 2 for an area, 1 for a length, 0 for a number without unit.
    measured : {'core', 'detail', 'bands'}
        With the core factors (`measure`), the detailed ones (`measure_detail`), or as one of their bands.
    derive : callable, optional
        How it follows from other factors: its parameters are their names. A factor without it is measured.
    quick : bool
        Whether candidates of a generation have it, by rays or derived from what rays find.
    axes : {'', 'chosen', 'feret'}
        Which axes it depends on: none, those of the convention that the caller chooses, or calipers.
    highest : float
        No body has more.
    by_symbol : bool
        Whether a ratio is better known by its symbol than by its title; sizes always are.
    voxels_only : tuple of {'crofton', 'smoothed'}
        With which area of a voxel grain it is found without the smoothed surface.
    left_open : float, mapping of str to float, or None
        What copies of one mask cannot show, in voxel edges over D_n: of the value (sizes) or as such
        (ratios); by convention where it depends on the chosen axes (docs/shape-factors.md, Intervals). None
        for a factor whose intervals were not tried on known bodies: it has none.
    """

    name: str
    title: str
    meaning: str
    aliases: tuple[str, ...] = ()
    symbol: str = ""
    formula: str = ""
    power: int = 0
    measured: Literal["core", "detail", "bands"] = "core"
    derive: Callable[..., Any] | None = None
    quick: bool = False
    axes: Literal["", "chosen", "feret"] = ""
    highest: float = float("inf")
    by_symbol: bool = False
    voxels_only: tuple[str, ...] = ()
    left_open: float | Mapping[str, float] | None = 1.0

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of the factors that it follows from."""
        return () if self.derive is None else tuple(inspect.signature(self.derive).parameters)

    @property
    def label(self) -> str:
        """Title and symbol: ``Sphericity ψ``."""
        return f"{self.title} {self.symbol}".strip()

    @property
    def short(self) -> str:
        """The symbol where people know it by that, else the title."""
        return self.symbol if self.symbol and (self.power or self.by_symbol) else self.title

    def unit(self, length: str) -> str:
        """Return the factor's unit as people write it (``mm²``); empty without one."""
        if not self.power or length == UNITLESS:
            return ""
        exponent = "" if self.power == 1 else str(self.power).translate(_SUPERSCRIPTS)
        return unit_label(length) + exponent

    def heading(self, length: str) -> str:
        """Return title, symbol and unit: the label of an axis or a column."""
        unit = self.unit(length)
        return f"{self.label} ({unit})" if unit else self.label

    def column(self, length: str) -> str:
        """Return a table's column, its unit in the name: ``volume_mm3``, ``sphericity``."""
        if not self.power or length == UNITLESS:
            return self.name
        exponent = "" if abs(self.power) == 1 else str(abs(self.power))
        return f"{self.name}_{'per_' if self.power < 0 else ''}{length}{exponent}"


class FactorTable(Mapping[str, Factor]):
    """Shape factors by name, in the order of tables.

    Parameters
    ----------
    factors : Factor
    """

    def __init__(self, *factors: Factor) -> None:
        # All together: a factor may stand before those that it follows from.
        self._factors = {factor.name: factor for factor in factors}
        for factor in factors:
            self._check(factor)

    def __getitem__(self, name: str) -> Factor:
        return self._factors[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._factors)

    def __len__(self) -> int:
        return len(self._factors)

    def add(self, factor: Factor) -> None:
        """Add a factor; from now on it is measured and shown like the others.

        Raises
        ------
        MeasureError
            If there is one of that name, the name cannot stand in a table's column, or the factor follows
            from one that is not in the table or is measured later.
        """
        if factor.name in self._factors:
            raise MeasureError(f"The factor '{factor.name}' exists already: give the new one another name.")
        self._check(factor)
        self._factors[factor.name] = factor

    def _check(self, factor: Factor) -> None:
        if not factor.name.isidentifier() or factor.name.startswith("_"):
            raise MeasureError(f"'{factor.name}' cannot name a factor: use letters, digits and underscores.")
        for name in factor.arguments:
            if name not in self._factors:
                known = ", ".join(self._factors)
                raise MeasureError(
                    f"'{factor.name}' depends on '{name}', which is not a factor: use one of {known}."
                )
            if factor.measured == "core" and self._factors[name].measured != "core":
                raise MeasureError(
                    f"'{factor.name}' depends on '{name}', a detailed factor: set measured='detail'."
                )
            if factor.quick and not self._factors[name].quick:
                raise MeasureError(f"'{factor.name}' depends on '{name}', which is not a quick factor.")

    @contextmanager
    def extended(self, *factors: Factor) -> Iterator[None]:
        """Hold further factors for as long as the context lasts."""
        before = dict(self._factors)
        try:
            for factor in factors:
                self.add(factor)
            yield
        finally:
            self._factors = before

    @property
    def core(self) -> tuple[str, ...]:
        """Names of the factors that `measure` finds."""
        return tuple(name for name, factor in self._factors.items() if factor.measured == "core")

    @property
    def detail(self) -> tuple[str, ...]:
        """Names of the factors that `measure_detail` finds beside the bands."""
        return tuple(name for name, factor in self._factors.items() if factor.measured == "detail")

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the bands' energies, from band 1."""
        return tuple(name for name, factor in self._factors.items() if factor.measured == "bands")

    @property
    def quick(self) -> tuple[str, ...]:
        """Names of the factors that every candidate of a generation has."""
        return tuple(name for name, factor in self._factors.items() if factor.quick)

    def value(self, name: str, known: Mapping[str, Any]) -> Any:
        """Return a factor that is known or follows from what is known.

        Parameters
        ----------
        name : str
        known : mapping of str to float or float array
            Factors by name; arrays are taken element by element.

        Returns
        -------
        float or float array
            NaN where the factor does not follow from what is known, or is not defined for it.
        """
        if name in known:
            return known[name]
        derive = self._factors[name].derive
        if derive is None:
            return float("nan")
        try:
            return derive(*(self.value(argument, known) for argument in self._factors[name].arguments))
        except (ArithmeticError, ValueError):
            return float("nan")


FACTORS = FactorTable(
    Factor(
        name="volume", title=mark("Volume"), symbol="V", power=3, quick=True,
        meaning=mark("Volume of the body"),
        voxels_only=("crofton", "smoothed"), left_open=0.02,
    ),
    Factor(
        name="area", title=mark("Surface area"), symbol="A", power=2, quick=True,
        meaning=mark("Area of the body's surface"),
        voxels_only=("crofton",), left_open=0.02,
    ),
    Factor(
        name="sphericity", title=mark("Sphericity"), symbol="ψ", quick=True,
        meaning=mark("Area of the sphere of the same volume over the surface area"),
        formula="π^(1/3) (6V)^(2/3) / A", derive=formulas.sphericity,
        highest=1.0, voxels_only=("crofton",), left_open=0.02,
    ),
    Factor(
        name="circularity", title=mark("Circularity"), symbol="C", quick=True,
        meaning=mark("Perimeter of the circle as large as the maximum projection, over its perimeter P_p"),
        formula="π Dₛ / P_p", highest=1.0, left_open=0.3,
    ),
    Factor(
        name="csf", aliases=("corey",), title=mark("Corey shape factor"), symbol="CSF", by_symbol=True,
        quick=True,
        meaning=mark("Shortest axis over the geometric mean of the two others"),
        formula="c / √(a b)", derive=formulas.corey_shape_factor,
        axes="chosen", highest=1.0, left_open={"obb": 1.1, "feret": 0.9},
    ),
    Factor(
        name="dn", aliases=("d_n",), title=mark("Nominal diameter"), symbol="Dₙ", power=1, quick=True,
        meaning=mark("Diameter of the sphere of the same volume"),
        formula="(6V/π)^(1/3)", derive=formulas.nominal_diameter,
        voxels_only=("crofton", "smoothed"), left_open=0.02,
    ),
    Factor(
        name="ds", aliases=("d_s",), title=mark("Projected diameter"), symbol="Dₛ", power=1, quick=True,
        meaning=mark("Diameter of the circle with the maximum projected area A_p"),
        formula="√(4 A_p/π)", left_open=0.2,
    ),
    Factor(
        name="dns", aliases=("d_ns",), title=mark("Diameter ratio"), symbol="Dₙ/Dₛ", by_symbol=True,
        quick=True,
        meaning=mark("Nominal diameter over the diameter of the projected circle"),
        derive=formulas.diameter_ratio, left_open=0.15,
    ),
    Factor(
        name="shortest", title=mark("Shortest axis"), symbol="c", power=1, quick=True,
        meaning=mark("Shortest of the three axes"),
        axes="chosen", left_open={"obb": 1.5, "feret": 1.2},
    ),
    Factor(
        name="intermediate", title=mark("Intermediate axis"), symbol="b", power=1, quick=True,
        meaning=mark("Middle one of the three axes; about the smallest opening that the body passes"),
        axes="chosen", left_open={"obb": 1.2, "feret": 2.2},
    ),
    Factor(
        name="longest", title=mark("Longest axis"), symbol="a", power=1, quick=True,
        meaning=mark("Longest of the three axes"),
        axes="chosen", left_open={"obb": 1.2, "feret": 0.75},
    ),
    Factor(
        name="krumbein", title=mark("Krumbein sphericity"), symbol="ψ_K", quick=True,
        meaning=mark("Intercept sphericity of Krumbein (1941)"),
        formula="(b c / a²)^(1/3)", derive=formulas.krumbein_sphericity,
        axes="chosen", highest=1.0, left_open={"obb": 0.6, "feret": 0.45},
    ),
    Factor(
        name="sneed_folk", title=mark("Sneed-Folk sphericity"), symbol="ψ_p", quick=True,
        meaning=mark("Maximum projection sphericity of Sneed and Folk (1958)"),
        formula="(c² / (a b))^(1/3)", derive=formulas.sneed_folk_sphericity,
        axes="chosen", highest=1.0, left_open={"obb": 0.75, "feret": 0.6},
    ),
    Factor(
        name="elongation", title=mark("Elongation ratio"), symbol="b/a", quick=True,
        meaning=mark("Intermediate over longest axis, after Zingg (1935)"),
        derive=formulas.elongation_ratio,
        axes="chosen", highest=1.0, left_open={"obb": 0.9, "feret": 1.5},
    ),
    Factor(
        name="flatness", title=mark("Flatness ratio"), symbol="c/b", quick=True,
        meaning=mark("Shortest over intermediate axis, after Zingg (1935)"),
        derive=formulas.flatness_ratio,
        axes="chosen", highest=1.0, left_open={"obb": 1.05, "feret": 1.2},
    ),
    Factor(
        name="potticary_elongation", title=mark("Potticary elongation"),
        meaning=mark("After Potticary et al. (2015): 0 for a plate, 1 for a needle"),
        formula="(a − b) / (a + b + c)", derive=formulas.potticary_elongation,
        axes="chosen", highest=1.0, left_open={"obb": 0.55, "feret": 0.6},
    ),
    Factor(
        name="potticary_flatness", title=mark("Potticary flatness"),
        meaning=mark("After Potticary et al. (2015): 1 for a plate, 0 for a needle"),
        formula="2 (b − c) / (a + b + c)", derive=formulas.potticary_flatness,
        axes="chosen", highest=1.0, left_open={"obb": 0.8, "feret": 0.8},
    ),
    Factor(
        name="angelidakis_elongation", title=mark("Angelidakis elongation"),
        meaning=mark("After Angelidakis et al. (2022): 0 for a plate, 1 for a needle"),
        formula="a c / (a c + b²) − c / (a + c)", derive=formulas.angelidakis_elongation,
        axes="chosen", highest=1.0, left_open={"obb": 0.55, "feret": 0.75},
    ),
    Factor(
        name="angelidakis_flatness", title=mark("Angelidakis flatness"),
        meaning=mark("After Angelidakis et al. (2022): 1 for a plate, 0 for a needle"),
        formula="b² / (a c + b²) − c / (a + c)", derive=formulas.angelidakis_flatness,
        axes="chosen", highest=1.0, left_open={"obb": 0.8, "feret": 0.8},
    ),
    Factor(
        name="convexity", title=mark("Convexity"), measured="detail",
        meaning=mark("Volume over that of the convex hull; 1 for a convex body"),
        highest=1.0, left_open=0.75,
    ),
    Factor(
        name="inscribed", title=mark("Inscribed diameter"), power=1, measured="detail",
        meaning=mark("Diameter of the largest sphere in the body"), left_open=1.0,
    ),
    Factor(
        name="enclosing", title=mark("Enclosing diameter"), power=1, measured="detail",
        meaning=mark("Diameter of the smallest sphere around the body"), left_open=0.7,
    ),
    Factor(
        name="sheppard", title=mark("Inscribed over nominal diameter"), measured="detail",
        meaning=mark("Diameter of the largest sphere in the body over the nominal diameter"),
        derive=formulas.sheppard_ratio, highest=1.0, left_open=0.8,
    ),
    Factor(
        name="feret_min", title=mark("Smallest Feret diameter"), power=1, measured="detail",
        meaning=mark("Least caliper diameter over all directions"), axes="feret", left_open=1.0,
    ),
    Factor(
        name="feret_mid", title=mark("Middle Feret diameter"), power=1, measured="detail",
        meaning=mark("Largest caliper diameter across the direction of the largest of all"),
        axes="feret", left_open=2.0,
    ),
    Factor(
        name="feret_max", title=mark("Largest Feret diameter"), power=1, measured="detail",
        meaning=mark("Largest caliper diameter over all directions"), axes="feret", left_open=0.6,
    ),
    Factor(
        name="roundness", title=mark("Roundness"), measured="detail",
        meaning=mark("Mean radius of curvature of the corners over that of the largest sphere in the body"),
        highest=1.0, left_open=None,
    ),
    Factor(
        name="roughness", title=mark("Roughness"), measured="detail",
        meaning=mark("Root mean square distance to the body smoothed at a sixteenth of Dₙ, over Dₙ"),
        left_open=0.1,
    ),
    *(
        Factor(
            name=f"band_{band}", title=mark("Band energy"), symbol="E" + str(band).translate(_SUBSCRIPTS),
            measured="bands",
            meaning=mark("Energy of one band of spherical harmonics of the radius, over that of band 0"),
        )
        for band in range(1, BANDS + 1)
    ),
)  # fmt: skip
"""Every shape factor. The core factors come first, in the order of their columns."""


FITTED_FACTORS = frozenset({"volume", "area", "sphericity", "dn"})
"""What the search for an avatar fits, and what follows from it alone: small errors of these show no
likeness."""


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """A factor that a direction of the latent space is named after.

    It is found by rays from the centre of a grain, about the axes of the ellipsoid of equal inertia, which
    change smoothly with the body as those of the smallest box do not.

    Attributes
    ----------
    factor : str
        Name in `FACTORS` of what it stands for there.
    title, short : str
        On a slider, and at the corner of a radar.
    plain : str
        Within a sentence.
    less, more : str
        What a grain is called that has less of it than another, or more.
    meaning : str
        What it is, for a tool tip.
    logarithmic : bool
        Whether steps along it are of its logarithm.
    """

    factor: str
    title: str
    short: str
    plain: str
    less: str
    more: str
    meaning: str
    logarithmic: bool = False


LATENT_MEANINGS: Mapping[str, Meaning] = {
    "size": Meaning(
        factor="dn", title=mark("Size Dₙ"), short=mark("Size"), plain=mark("size"),
        less=mark("smaller"), more=mark("larger"), logarithmic=True,
        meaning=mark("Diameter of the sphere of the same volume"),
    ),
    "elongation": Meaning(
        factor="elongation", title=mark("Elongation I/L"), short="I/L", plain=mark("elongation"),
        less=mark("longer"), more=mark("shorter"),
        meaning=mark("Intermediate over longest axis of the ellipsoid of equal inertia"),
    ),
    "csf": Meaning(
        factor="csf", title=mark("Corey factor CSF"), short="CSF", plain=mark("Corey factor"),
        less=mark("flatter"), more=mark("thicker"),
        meaning=mark("Corey shape factor of the ellipsoid of equal inertia"),
    ),
    "sphericity": Meaning(
        factor="sphericity", title=mark("Sphericity ψ"), short="ψ", plain=mark("sphericity"),
        less=mark("less spherical"), more=mark("rounder"),
        meaning=mark("Area of the sphere of the same volume over the surface area"),
    ),
    "roughness": Meaning(
        factor="roughness", title=mark("Roughness"), short=mark("Roughness"), plain=mark("roughness"),
        less=mark("smoother"), more=mark("rougher"),
        meaning=mark("Root mean square of ln r beyond an ellipsoid and harmonics up to degree 4"),
    ),
}  # fmt: skip
"""The meanings of the latent space, in the order of their columns."""


@dataclass(frozen=True)
class Axes:
    """A convention of the axis lengths a ≥ b ≥ c.

    Attributes
    ----------
    title, meaning : str
        In words, with capitals.
    """

    title: str
    meaning: str


AXES: Mapping[str, Axes] = {
    "obb": Axes(mark("Oriented box"), mark("Edges of the oriented bounding box of least volume")),
    "feret": Axes(mark("Feret"), mark("Caliper (Feret) diameters")),
    "inertia": Axes(mark("Inertia"), mark("Axes of the homogeneous ellipsoid with the same inertia")),
}
"""Conventions of the axis lengths, by their names in `measure`."""
