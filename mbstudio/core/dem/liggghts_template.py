"""The command by which LIGGGHTS reads a clump, with our mass and inertia."""

from __future__ import annotations

from mbstudio.core.dem.body import DemBody
from mbstudio.core.units import METRES_PER_UNIT


def template_command(
    body: DemBody, spheres_file: str, nspheres: int, number: int, ntry: int, scale: float = 1.0
) -> str:
    """Return the ``fix particletemplate/multisphere`` command of one body: SI units, principal axes.

    Parameters
    ----------
    body : DemBody
    spheres_file : str
    nspheres : int
        Lines of that file.
    number : int
        Of the template, from 1.
    ntry : int
        Monte Carlo points.
    scale : float
        Size over the body's: mass goes by its third power, inertia by its fifth.
    """
    mass = body.mass.mass * scale**3
    metres = METRES_PER_UNIT[body.mass.unit]
    ixx, iyy, izz = (f"{moment:.9e}" for moment in body.mass.principal * metres**2 * scale**5)
    return (
        f"# {body.name}: mass in kg, inertia tensor in kg m2 as Ixx Ixy Ixz Iyy Iyz Izz\n"
        f"fix template{number} all particletemplate/multisphere {prime_above(15485863 + 1000 * number)} &\n"
        f"    atom_type 1 density constant {body.mass.density:.9g} &\n"
        f"    nspheres {nspheres} ntry {ntry} spheres file {spheres_file} scale {metres * scale:.9g} &\n"
        f"    mass {mass:.9e} inertia_tensor {ixx} 0 0 {iyy} 0 {izz} use_volume type {number}\n"
    )


def prime_above(number: int) -> int:
    """Return the smallest prime above a number: LIGGGHTS wants prime seeds."""
    candidate = number + 1 + number % 2
    while any(candidate % divisor == 0 for divisor in range(3, int(candidate**0.5) + 1, 2)):
        candidate += 2
    return candidate
