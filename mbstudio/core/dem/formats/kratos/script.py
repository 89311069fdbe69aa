"""The script of a Kratos export, which runs the case and watches it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.specimen.deck_cost import Bounds, DeckCost
from mbstudio.core.dem.specimen.settling import GRAVITY
from mbstudio.core.errors import ExportError

_MARK = "# From here on the script is the same for all exports.\n"
_SCRIPT = '''"""Let the clusters fall. Run within this folder: python settle.py

It takes {told}.
It writes settled.csv: where every cluster came to rest and how it is turned (m, quaternion w x y z), for
'mbstudio packing read'. The last line that it prints begins with SETTLED.
It ends with an error if a cluster is lost, more energy is there than there was to fall, or clusters lie
deeper in each other or in a wall than twice the hardest fall by design.
"""

NAMES = {names}
HALF = {half:.9g}  # of the box, in m
ENERGY = {energy:.6g}  # J, all that there is to fall
IMPACT, REST = {impact:.6g}, {rest:.6g}  # m, most overlap in the fall and at rest
SOLID = {solid:.9g}  # m3, of all grains
GRAVITY = {gravity}
'''
_SAME = (
    _MARK
    + '''
import csv
import sys
from collections import defaultdict
from itertools import product
from math import dist

import KratosMultiphysics
import KratosMultiphysics.DEMApplication as dem
from KratosMultiphysics.DEMApplication.DEM_analysis_stage import DEMAnalysisStage

AROUND = list(product((-1, 0, 1), repeat=3))


def overlaps(places, radii, owners):
    """Return the largest overlap of spheres, with others or walls, and the pairs of clusters that touch."""
    pitch = 2 * max(radii)
    cells = defaultdict(list)
    for number, place in enumerate(places):
        cells[tuple(int(value // pitch) for value in place)].append(number)
    deepest, pairs = 0.0, set()
    for (x, y, z), mine in cells.items():
        for dx, dy, dz in AROUND:
            for i in mine:
                for j in cells.get((x + dx, y + dy, z + dz), ()):
                    if owners[i] < owners[j]:
                        depth = radii[i] + radii[j] - dist(places[i], places[j])
                        if depth > 0:
                            pairs.add((owners[i], owners[j]))
                            deepest = max(deepest, depth)
    for place, radius in zip(places, radii):
        outside = max(abs(place[0]), abs(place[1])) + radius - HALF
        deepest = max(deepest, outside, radius - place[2])
    return deepest, pairs


class Settling(DEMAnalysisStage):
    """Prints number, kinetic energy and overlap of the clusters now and then, and watches them."""

    def Initialize(self):
        super().Initialize()
        self.count = len(self.cluster_model_part.Nodes)
        # The spheres of the clusters follow each other in their order.
        self.owners = []
        for number, element in enumerate(self.cluster_model_part.Elements):
            name = NAMES[element.Properties.Id - 1]
            with open(name + ".clu") as stream:
                text = stream.read()
            spheres = text.partition("Begin centers_and_radii\\n")[2].partition("\\nEnd")[0].count("\\n") + 1
            self.owners += [number] * spheres

    def energy(self):
        """Return the kinetic energy of translation, in J."""
        total = 0.0
        for node in self.cluster_model_part.Nodes:
            velocity = node.GetSolutionStepValue(KratosMultiphysics.VELOCITY)
            mass = node.GetSolutionStepValue(KratosMultiphysics.NODAL_MASS)
            total += 0.5 * mass * sum(v * v for v in velocity)
        return total

    def look(self):
        """Return energy, largest overlap and touching pairs; end with an error where something is wrong."""
        there = len(self.cluster_model_part.Nodes)
        if there != self.count:
            sys.exit(f"{self.count - there} of {self.count} clusters are lost.")
        nodes = [element.GetNodes()[0] for element in self.spheres_model_part.Elements]
        if len(nodes) != len(self.owners):
            sys.exit(f"{len(self.owners) - len(nodes)} spheres of clusters are lost.")
        kinetic = self.energy()
        if not kinetic <= ENERGY:
            sys.exit(f"There is more energy ({kinetic:.3g} J) than there was to fall: too long a step.")
        places = [(node.X, node.Y, node.Z) for node in nodes]
        radii = [node.GetSolutionStepValue(KratosMultiphysics.RADIUS) for node in nodes]
        deepest, pairs = overlaps(places, radii, self.owners)
        if not deepest <= IMPACT:
            sys.exit(f"Clusters overlap by {deepest:.3g} m, more than they are designed to: {IMPACT:.3g} m.")
        return kinetic, deepest, pairs

    def OutputSolutionStep(self):
        super().OutputSolutionStep()
        process = self.spheres_model_part.ProcessInfo
        if process[KratosMultiphysics.TIME_STEPS] % 250:
            return
        kinetic, deepest, _ = self.look()
        print("SETTLING", process[KratosMultiphysics.TIME], self.count, kinetic, deepest, flush=True)

    def Finalize(self):
        kinetic, deepest, pairs = self.look()
        if deepest > REST:
            sys.exit(f"At rest clusters overlap by {deepest:.3g} m, more than {REST:.3g} m: too soft.")
        weight = moment = 0.0
        with open("settled.csv", "w", newline="") as stream:
            rows = csv.writer(stream)
            rows.writerow(["number", "avatar", "scale", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"])
            for number, element in enumerate(self.cluster_model_part.Elements, start=1):
                node = element.GetNodes()[0]
                turn = node.GetSolutionStepValue(KratosMultiphysics.ORIENTATION)
                mass = node.GetSolutionStepValue(KratosMultiphysics.NODAL_MASS)
                weight, moment = weight + mass, moment + mass * node.Z
                turned = [turn.W, turn.X, turn.Y, turn.Z]
                name = NAMES[element.Properties.Id - 1]
                rows.writerow([number, name, 1.0, node.X, node.Y, node.Z, *turned])
        # Of an even layer the centre of mass lies at half its height.
        height = 2 * moment / weight
        porosity = 1 - SOLID / (4 * HALF * HALF * height)
        print(
            f"SETTLED {self.count} grains, porosity {porosity:.4g}, height {height:.4g} m,"
            f" {2 * len(pairs) / self.count:.3g} neighbours a grain, overlap {deepest:.3g} m,"
            f" kinetic energy {kinetic:.3g} J",
            flush=True,
        )
        super().Finalize()


if __name__ == "__main__":
    KratosMultiphysics.Logger.GetDefaultOutput().SetSeverity(KratosMultiphysics.Logger.Severity.WARNING)
    with open("ProjectParametersDEM.json") as stream:
        parameters = KratosMultiphysics.Parameters(stream.read())
    Settling(KratosMultiphysics.Model(), parameters).Run()
'''
)


def script_text(names: Sequence[str], half: float, solid: float, bounds: Bounds, cost: DeckCost) -> str:
    """Return the script; SI units throughout.

    Parameters
    ----------
    names : sequence of str
        Of the clusters' files, by their kinds.
    half : float
        Half the width of the box.
    solid : float
        Volume of all grains.
    bounds : Bounds
    cost : DeckCost
    """
    head = _SCRIPT.format(
        told=cost.told,
        names=repr(list(names)),
        half=half,
        energy=bounds.energy,
        impact=bounds.impact,
        rest=bounds.rest,
        solid=solid,
        gravity=GRAVITY,
    )
    return head + _SAME


def check_script(path: Path, names: Sequence[str]) -> None:
    """Raise ExportError unless a script names the clusters in order and is the one that mbstudio writes."""
    text = read_text(path)
    if not text.endswith(_SAME):
        raise ExportError(f"{path} is not the script that mbstudio writes: export again.")
    if f"\nNAMES = {list(names)!r}\n" not in text:
        raise ExportError(f"{path} does not name the clusters of the manifest in order.")
