"""The example driver of a MercuryDPM export: some of each clump fall into a box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mbstudio.core.dem.formats.cpp_deck import check_cpp_deck, constants, names_table, number_table
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.pouring import NOT_RUN, extent_of, plan_pouring
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

DECK_NAME = "Settle.cpp"

_HEAD = """#include "Mercury3D.h"
#include "Walls/InfiniteWall.h"
#include "Species/LinearViscoelasticFrictionSpecies.h"
#include "Particles/ClumpParticle.h"
#include "../ClumpHeaders/Mercury3DClump.h"
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

"""
_BODY = """
// The numbers of a comma-separated file, row after row.
std::vector<double> readNumbers(const std::string& name)
{
    std::ifstream file(name.c_str());
    if (!file) throw std::runtime_error("cannot read " + name);
    std::vector<double> numbers;
    std::string line, word;
    while (std::getline(file, line))
    {
        std::istringstream words(line);
        while (std::getline(words, word, ',')) numbers.push_back(std::stod(word));
    }
    return numbers;
}

class Settle : public Mercury3Dclump
{
public:
    explicit Settle(const std::string& exported) : folder(exported)
    {
        setName("Settle");
        setGravity(Vec3D(0.0, 0.0, -GRAVITY));
        setMin(Vec3D(-HALF, -HALF, 0.0));
        setMax(Vec3D(HALF, HALF, 1.4 * TOP));
    }

    void setupInitialConditions() override
    {
        const int kinds = sizeof(KINDS) / sizeof(KINDS[0]);
        const int grains = sizeof(PLACES) / sizeof(PLACES[0]);
        for (int i = 0; i < grains; i++) addGrain(KINDS[i % kinds], PLACES[i], QUATERNIONS[i]);
        addWall(Vec3D(0.0, 0.0, -1.0), Vec3D(0.0, 0.0, 0.0));
        addWall(Vec3D(-1.0, 0.0, 0.0), Vec3D(-HALF, 0.0, 0.0));
        addWall(Vec3D(1.0, 0.0, 0.0), Vec3D(HALF, 0.0, 0.0));
        addWall(Vec3D(0.0, -1.0, 0.0), Vec3D(0.0, -HALF, 0.0));
        addWall(Vec3D(0.0, 1.0, 0.0), Vec3D(0.0, HALF, 0.0));
    }

private:
    void addWall(const Vec3D& outward, const Vec3D& point)
    {
        InfiniteWall wall;
        wall.setSpecies(speciesHandler.getObject(0));
        wall.set(outward, point);
        wallHandler.copyAndAddObject(wall);
    }

    void addGrain(const std::string& kind, const double* place, const double* q)
    {
        const std::vector<double> spheres = readNumbers(folder + "/" + kind + "/Clump/Clump.txt");
        const std::vector<double> mass = readNumbers(folder + "/" + kind + "/Inertia/Mass.txt");
        const std::vector<double> toi = readNumbers(folder + "/" + kind + "/Inertia/TOI.txt");
        ClumpParticle grain;
        grain.setSpecies(speciesHandler.getObject(0));
        grain.setClump();
        grain.setRadius(spheres[3]);
        for (std::size_t j = 0; j + 3 < spheres.size(); j += 4)
            grain.addPebble(Vec3D(spheres[j], spheres[j + 1], spheres[j + 2]), spheres[j + 3]);
        // The columns are the grain's own axes in space: the matrix is the rotation of the quaternion.
        const double w = q[0], x = q[1], y = q[2], z = q[3];
        grain.setPrincipalDirections(Matrix3D(
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)));
        grain.setInitInertia(MatrixSymmetric3D(toi[0], toi[1], toi[2], toi[4], toi[5], toi[8]));
        grain.setClumpMass(mass[0]);
        grain.setDamping(0.0);
        grain.setPosition(Vec3D(place[0], place[1], place[2]));
        grain.setVelocity(Vec3D(0.0, 0.0, 0.0));
        grain.setAngularVelocity(Vec3D(0.0, 0.0, 0.0));
        particleHandler.copyAndAddObject(grain);
    }

    std::string folder;
};

int main(int argc, char* argv[])
{
    Settle problem(argc > 1 ? argv[1] : ".");
    auto species = problem.speciesHandler.copyAndAddObject(LinearViscoelasticFrictionSpecies());
    species->setDensity(DENSITY);
    species->setStiffness(STIFFNESS);
    species->setDissipation(DISSIPATION);
    species->setSlidingStiffness(2.0 / 7.0 * STIFFNESS);
    species->setSlidingDissipation(2.0 / 7.0 * DISSIPATION);
    species->setSlidingFrictionCoefficient(0.5);
    problem.setTimeStep(STEP);
    problem.setTimeMax(SECONDS);
    problem.setSaveCount(static_cast<unsigned>(SECONDS / STEP / 20));
    problem.setHGridMaxLevels(1);
    problem.removeOldFiles();
    problem.solve();
    return 0;
}
"""


def settling_deck(job: Job, clumps: Sequence[Clump]) -> str:
    """Return a driver in SI units that reads the folders of the export by itself.

    It does not use MercuryDPM's own loader, which reads every folder of its source tree and whose names of
    files have changed from version to version.
    """
    plan = plan_pouring(job, *extent_of(clumps))
    return (
        f"// {len(plan.stack.places)} grains fall into a box, in SI units. Put this file into a folder\n"
        "// of its own in MercuryDPM's Drivers/Clump, build it there, run: ./Settle FOLDER-OF-EXPORT\n"
        f"// {NOT_RUN}\n"
        + _HEAD
        + constants(plan)
        + f"const double DISSIPATION = {plan.dissipation:.6g};  // kg/s, restitution about 0.3\n"
        + names_table([body.name for body in job.bodies])
        + number_table("PLACES", plan.stack.places)
        + "// w, x, y, z\n"
        + number_table("QUATERNIONS", plan.stack.quaternions)
        + _BODY
    )


def check_deck(path: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless a driver reads the folders of the manifest and has its numbers."""
    text = check_cpp_deck(path, manifest, [item["name"] for item in manifest["items"]])
    if not text.endswith(_BODY):
        raise ExportError(f"{path} is not the driver that mbstudio writes: export again.")
