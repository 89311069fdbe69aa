"""The example program of a MechSys export: some of each polyhedron fall into a box."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mbstudio.core.dem.formats.cpp_deck import check_cpp_deck, constants, names_table, number_table
from mbstudio.core.dem.specimen.pouring import NOT_RUN, plan_pouring, stated_number
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

DECK_NAME = "settle.cpp"
_ROUNDING = 0.05

_HEAD = """#include <mechsys/dem/domain.h>
#include <mechsys/util/fatal.h>
#include <cmath>
#include <cstdlib>

"""
_BODY = """
using namespace DEM;  // where the quaternions are, depending on the version

// Tags of the five walls go down from FLOOR, those of the kinds of grain, however many, from FIRST_KIND.
const int FLOOR = -1, FIRST_KIND = -11;

void addWall(DEM::Domain & dom, int tag, Vec3_t const & place, double width, double height, double angle,
             Vec3_t axis)
{
    dom.AddPlane(tag, place, R, width, height, DENSITY, angle, &axis);
    dom.GetParticle(tag)->FixVeloc();
}

void addGrain(DEM::Domain & dom, int tag, char const * file, double const * place, double const * q)
{
    dom.AddFromJson(tag, file, R, DENSITY, /*scale*/1.0);
    size_t last = dom.Particles.Size()-1;
    Quaternion_t turn;
    double sine = sqrt(q[1]*q[1] + q[2]*q[2] + q[3]*q[3]);
    Vec3_t axis(0.0, 0.0, 1.0);
    if (sine > 0.0) axis = Vec3_t(q[1]/sine, q[2]/sine, q[3]/sine);
    NormalizeRotation(2.0*atan2(sine, q[0]), axis, turn);
    dom.Particles[last]->Rotate(turn, dom.Particles[last]->x);
    // Rotate turns the vertices alone: the axes of the moments of inertia, Q, are to follow.
    Quaternion_t axes = dom.Particles[last]->Q, turned;
    QuaternionProduct(turn, axes, turned);
    dom.Particles[last]->Q = turned;
    Vec3_t shift(place[0], place[1], place[2]);
    dom.Particles[last]->Translate(shift);
    dom.Particles[last]->Ff = dom.Particles[last]->Props.m*Vec3_t(0.0, 0.0, -GRAVITY);
}

int main(int argc, char ** argv) try
{
    size_t threads = argc > 1 ? atoi(argv[1]) : 1;
    DEM::Domain dom;
    dom.Alpha = R;  // the Verlet distance
    size_t kinds = sizeof(KINDS)/sizeof(KINDS[0]), grains = sizeof(PLACES)/sizeof(PLACES[0]);
    for (size_t i=0; i<grains; i++)
        addGrain(dom, FIRST_KIND-int(i%kinds), KINDS[i%kinds], PLACES[i], QUATERNIONS[i]);
    double height = 1.4*TOP, out = HALF + R;
    addWall(dom, FLOOR,   Vec3_t(0.0, 0.0, -R),          2.0*out, 2.0*out, 0.0,      OrthoSys::e2);
    addWall(dom, FLOOR-1, Vec3_t(0.0,  out, 0.5*height), 2.0*out, height,  M_PI/2.0, OrthoSys::e0);
    addWall(dom, FLOOR-2, Vec3_t(0.0, -out, 0.5*height), 2.0*out, height,  M_PI/2.0, OrthoSys::e0);
    addWall(dom, FLOOR-3, Vec3_t( out, 0.0, 0.5*height), height,  2.0*out, M_PI/2.0, OrthoSys::e1);
    addWall(dom, FLOOR-4, Vec3_t(-out, 0.0, 0.5*height), height,  2.0*out, M_PI/2.0, OrthoSys::e1);
    for (size_t i=0; i<dom.Particles.Size(); i++)
    {
        dom.Particles[i]->Props.Kn = STIFFNESS;
        dom.Particles[i]->Props.Kt = 0.5*STIFFNESS;
        dom.Particles[i]->Props.Gn = -0.3;  // below zero: the restitution
        dom.Particles[i]->Props.Mu = 0.5;
    }
    dom.Solve(SECONDS, STEP, SECONDS/20.0, NULL, NULL, "settle", 2, threads);
    return 0;
}
MECHSYS_CATCH
"""


def settling_deck(job: Job, reach: float) -> str:
    """Return a program in kg, s and the unit of the export.

    MechSys rounds all edges by R, outwards: here a twentieth of the largest bounding radius, which contacts
    need to be found. It weighs the polyhedra by itself.

    Parameters
    ----------
    job : Job
    reach : float
        Of the largest polyhedron, in the unit of the export.
    """
    rounding = float(f"{_ROUNDING * reach:.6g}")
    plan = plan_pouring(job, reach + rounding, rounding)
    return (
        f"// {len(plan.stack.places)} grains fall into a box. Units: {job.unit}, kg, s (stiffness in N/m).\n"
        "// Build as one of MechSys's own programs (CMake), run within this folder: ./settle THREADS\n"
        f"// {NOT_RUN}\n"
        + _HEAD
        + constants(plan)
        + f"const double R = {rounding:.6g};  // all edges are rounded by this, outwards\n"
        + names_table([f"{body.name}.json" for body in job.bodies])
        + number_table("PLACES", plan.stack.places)
        + "// w, x, y, z\n"
        + number_table("QUATERNIONS", plan.stack.quaternions)
        + _BODY
    )


def check_deck(path: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless a program loads the files of the manifest and has its numbers."""
    text = check_cpp_deck(path, manifest, [item["files"][0] for item in manifest["items"]])
    rounding = stated_number(path, text, "R")
    size = max(item["volume"] for item in manifest["items"]) ** (1 / 3)
    if not 0.0 < rounding < size / 2:
        raise ExportError(
            f"{path} rounds edges by {rounding:g}, which does not match any grain of this export."
        )
    if not text.endswith(_BODY):
        raise ExportError(f"{path} is not the program that mbstudio writes: export again.")
