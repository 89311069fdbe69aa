"""The example case of a Kratos export: some of each cluster fall into a box and settle."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.formats.kratos.script import check_script, script_text
from mbstudio.core.dem.reading_back import number_rows, read_text, require_agreement
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.deck_cost import DeckCost, bounds_of, require_affordable
from mbstudio.core.dem.specimen.pouring import check_count
from mbstudio.core.dem.specimen.settling import (
    GRAVITY,
    POISSON,
    SettlingBox,
    Stack,
    finest_sphere,
    stacked_grains,
)
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

MATERIALS_NAME = "MaterialsDEM.json"
PARAMETERS_NAME = "ProjectParametersDEM.json"
SCRIPT_NAME = "settle.py"
CASE_FILES = (
    SCRIPT_NAME,
    PARAMETERS_NAME,
    MATERIALS_NAME,
    "settleDEM_Clusters.mdpa",
    "settleDEM_FEM_boundary.mdpa",
)
_CLUSTERS, _BOX = CASE_FILES[3:]
_SEARCH_EVERY = 10
_LAW = "DEM_D_Hertz_viscous_Coulomb"


def write_case(job: Job, clumps: Sequence[Clump], poured: int) -> Mapping[str, Any]:
    """Write a case in SI units that runs as it is, from within its folder (Kratos 10); return what it costs.

    Raises
    ------
    ExportError
        If it would take longer than the export allows.
    """
    bodies, folder = job.bodies, job.folder
    sizes = [2 * float((np.linalg.norm(c.centers, axis=1) + c.radii).max()) for c in clumps]
    stack = stacked_grains(poured, len(bodies), max(sizes) / 2)
    kinds = np.arange(len(stack.places)) % len(bodies)
    masses = np.array([body.mass.mass for body in bodies])
    box = SettlingBox(
        len(kinds), max(sizes) / 2, min(float(c.radii.min()) for c in clumps),
        float(masses.max()), float(masses[kinds].mean()), float(masses.min()), finest_sphere(clumps),
        stack.half, 0.0, stack.top,
    )  # fmt: skip
    materials, step, impact = _materials(bodies, clumps, stack.top)
    seconds = 4.0 * float(np.sqrt(2 * stack.top / GRAVITY))
    spheres = sum(len(clumps[int(kind)].radii) for kind in kinds)
    cost = DeckCost("Kratos", int(np.ceil(seconds / step)), step, spheres)
    require_affordable(job, SCRIPT_NAME, cost, box)
    density = bodies[0].mass.density
    solid = float(masses[kinds].sum() / density)
    parameters = _parameters(stack.half, stack.top, step, seconds)
    for name, content in ((MATERIALS_NAME, materials), (PARAMETERS_NAME, parameters)):
        (folder / name).write_text(json.dumps(content, indent=2) + "\n", encoding="ascii")
    bounds = bounds_of(box, impact, density)
    script = script_text([body.name for body in bodies], stack.half, solid, bounds, cost)
    (folder / SCRIPT_NAME).write_text(script, encoding="ascii")
    (folder / CASE_FILES[3]).write_text(_clusters(stack, sizes), encoding="ascii")
    (folder / CASE_FILES[4]).write_text(_box(stack.half, stack.top), encoding="ascii")
    return cost.record()


def _materials(
    bodies: Sequence[DemBody], clumps: Sequence[Clump], top: float
) -> tuple[dict[str, Any], float, float]:
    """Return one material a cluster and one for the walls, the time step, and the hardest fall's overlap.

    Young's modulus is such that the fall overlaps by a fifth of the smallest sphere (Hertz), the step a
    30th of that contact.
    """
    smallest = min(float(clump.radii.min()) for clump in clumps)
    heaviest = max(body.mass.mass for body in bodies)
    overlap, speed = 0.2 * smallest, float(np.sqrt(2 * GRAVITY * top))
    young = 15 / 16 * heaviest * speed**2 / (np.sqrt(smallest) * overlap**2.5) * (1 - POISSON**2)
    step = float(f"{2.94 * overlap / speed / 30:.3g}")
    walls = len(bodies) + 1
    materials = [
        {
            "material_name": body.name,
            "material_id": number,
            "Variables": {
                "PARTICLE_DENSITY": bodies[0].mass.density,
                "YOUNG_MODULUS": float(young),
                "POISSON_RATIO": POISSON,
                "CLUSTER_FILE_NAME": f"{body.name}.clu",
                "BREAKABLE_CLUSTER": False,
            },
        }
        for number, body in enumerate(bodies, start=1)
    ]
    wall = {
        "material_name": "walls",
        "material_id": walls,
        "Variables": {"YOUNG_MODULUS": float(100 * young), "POISSON_RATIO": POISSON, "COMPUTE_WEAR": False},
    }
    contact = {
        "COEFFICIENT_OF_RESTITUTION": 0.3,
        "STATIC_FRICTION": 0.5,
        "DYNAMIC_FRICTION": 0.5,
        "FRICTION_DECAY": 500.0,
        "ROLLING_FRICTION": 0.01,
        "ROLLING_FRICTION_WITH_WALLS": 0.01,
        "DEM_ROLLING_FRICTION_MODEL_NAME": "DEMRollingFrictionModelBounded",
        "DEM_DISCONTINUUM_CONSTITUTIVE_LAW_NAME": _LAW,
    }
    names = {number: body.name for number, body in enumerate(bodies, start=1)} | {walls: "walls"}
    pairs = [(i, j) for i in range(1, walls) for j in range(i, walls + 1)]
    relations = [
        {"material_names_list": [names[i], names[j]], "material_ids_list": [i, j], "Variables": contact}
        for i, j in pairs
    ]
    table = [[f"ClusterPart.kind{number}", names[number]] for number in range(1, walls)]
    return (
        {
            "materials": [*materials, wall],
            "material_relations": relations,
            "material_assignation_table": [*table, ["RigidFacePart", "walls"]],
        },
        step,
        overlap,
    )


def _parameters(half: float, top: float, step: float, seconds: float) -> dict[str, Any]:
    # What comes together between two searches goes through each other: neighbours are looked for
    # as far as two grains at full speed come nearer until the next search, half as far again for their spin.
    nearing = 2 * float(np.sqrt(2 * GRAVITY * top)) * step * _SEARCH_EVERY
    return {
        "problem_name": "settle",
        "Dimension": 3,
        "BoundingBoxOption": True,
        "BoundingBoxEnlargementFactor": 1.1,
        **{f"BoundingBoxMax{axis}": 4 * half for axis in "XY"},
        **{f"BoundingBoxMin{axis}": -4 * half for axis in "XY"},
        "BoundingBoxMaxZ": 2 * top,
        "BoundingBoxMinZ": -top,
        "dem_inlet_option": False,
        "GravityZ": -GRAVITY,
        "RotationOption": True,
        "solver_settings": {
            "RemoveBallsInitiallyTouchingWalls": False,
            "strategy": "sphere_strategy",
            "material_import_settings": {"materials_filename": MATERIALS_NAME},
        },
        "processes": {"constraints_process_list": [], "loads_process_list": [], "list_other_processes": []},
        "ElementType": "SphericPartDEMElement3D",
        "TranslationalIntegrationScheme": "Symplectic_Euler",
        "RotationalIntegrationScheme": "Direct_Integration",
        "MaxTimeStep": step,
        "FinalTime": seconds,
        "NeighbourSearchFrequency": _SEARCH_EVERY,
        "DeltaOption": "Absolute",
        "SearchTolerance": 1.5 * nearing,
        "search_tolerance_against_walls": 1.5 * nearing,
        "do_print_results_option": False,
        "GraphExportFreq": 2 * seconds,
        "VelTrapGraphExportFreq": 2 * seconds,
        "OutputTimeStep": 2 * seconds,
    }


def _clusters(stack: Stack, sizes: Sequence[float]) -> str:
    """Return the clusters' mdpa: the kinds in turn, turned at random, quaternions as (x, y, z, w)."""
    numbers = range(1, len(stack.places) + 1)
    kinds = [(number - 1) % len(sizes) for number in numbers]
    turns = stack.quaternions[:, [1, 2, 3, 0]]
    nodes = [f"{n} {x:.9e} {y:.9e} {z:.9e}" for n, (x, y, z) in zip(numbers, stack.places, strict=True)]
    elements = [f"{n} {kind + 1} {n}" for n, kind in zip(numbers, kinds, strict=True)]
    lengths = [f"{n} 0 {sizes[kind]:.12e}" for n, kind in zip(numbers, kinds, strict=True)]
    turned = [
        f"{n} 0 [4] ( {', '.join(f'{part:.9f}' for part in turn)} )"
        for n, turn in zip(numbers, turns, strict=True)
    ]
    text = "Begin ModelPartData\nEnd ModelPartData\n\n"
    text += "".join(f"Begin Properties {kind + 1}\nEnd Properties\n" for kind in range(len(sizes)))
    for head, rows in (
        ("Nodes", nodes),
        ("Elements Cluster3D", elements),
        ("NodalData CHARACTERISTIC_LENGTH", lengths),
        ("NodalData ORIENTATION", turned),
    ):
        text += f"\nBegin {head}\n" + "\n".join(rows) + f"\nEnd {head.split()[0]}\n"
    for kind in range(len(sizes)):
        mine = "\n".join(str(n) for n, other in zip(numbers, kinds, strict=True) if other == kind)
        text += (
            f"\nBegin SubModelPart kind{kind + 1}\nBegin SubModelPartNodes\n{mine}\nEnd SubModelPartNodes\n"
            f"Begin SubModelPartElements\n{mine}\nEnd SubModelPartElements\nEnd SubModelPart\n"
        )
    return text


def _box(half: float, top: float) -> str:
    """Return the mdpa of a floor and four walls, normals inwards."""
    low = [(-half, -half), (half, -half), (half, half), (-half, half)]
    corners = [(x, y, z) for z in (0.0, 1.5 * top) for x, y in low]
    quads = [(1, 2, 3, 4), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 8, 4), (4, 8, 5, 1)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    nodes = "\n".join(f"{n} {x:.9e} {y:.9e} {z:.9e}" for n, (x, y, z) in enumerate(corners, start=1))
    conditions = "\n".join(f"{n} 0 {a} {b} {c}" for n, (a, b, c) in enumerate(faces, start=1))
    return (
        "Begin ModelPartData\nEnd ModelPartData\n\nBegin Properties 0\nEnd Properties\n\n"
        f"Begin Nodes\n{nodes}\nEnd Nodes\n\n"
        f"Begin Conditions RigidFace3D3N\n{conditions}\nEnd Conditions\n\n"
        "Begin SubModelPart walls\nBegin SubModelPartData\nFIXED_MESH_OPTION 0\nRIGID_BODY_MOTION 1\n"
        "FREE_BODY_MOTION 0\nIS_GHOST 0\nIDENTIFIER walls\nFORCE_INTEGRATION_GROUP 0\nEnd SubModelPartData\n"
        "Begin SubModelPartNodes\n" + "\n".join(map(str, range(1, 9))) + "\nEnd SubModelPartNodes\n"
        "Begin SubModelPartConditions\n"
        + "\n".join(str(n) for n in range(1, len(faces) + 1))
        + "\nEnd SubModelPartConditions\nEnd SubModelPart\n"
    )


def check_case(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless materials, parameters, clusters, box and script are those of the manifest.

    Raises
    ------
    ExportError
        For another density, a material without its cluster, gravity upwards or none, a time step that is not
        positive, clusters of a kind that is not there, turns that are no rotations, a box that is not whole,
        or another script.
    """
    _check_materials(folder / MATERIALS_NAME, manifest)
    _check_parameters(folder / PARAMETERS_NAME)
    _check_clusters(folder / _CLUSTERS, manifest)
    path = folder / _BOX
    text = _balanced(path)
    corners, faces = _block(path, text, "Nodes", 4), _block(path, text, "Conditions RigidFace3D3N", 5)
    if len(corners) != 8 or len(faces) != 10:
        raise ExportError(f"{path} is not a box with a floor and four walls.")
    check_script(folder / SCRIPT_NAME, [item["name"] for item in manifest["items"]])


def _json(path: Path) -> Any:
    try:
        return json.loads(read_text(path))
    except ValueError as error:
        raise ExportError(f"{path} cannot be read ({error}).") from error


def _check_materials(path: Path, manifest: Mapping[str, Any]) -> None:
    content = _json(path)
    try:
        found = [
            (str(entry["Variables"]["CLUSTER_FILE_NAME"]), str(entry["Variables"]["PARTICLE_DENSITY"]))
            for entry in content["materials"]
            if "CLUSTER_FILE_NAME" in entry["Variables"]
        ]
    except (KeyError, TypeError) as error:
        raise ExportError(f"{path} has a missing or invalid entry {error}.") from error
    for item in manifest["items"]:
        if item["files"][0] not in [file for file, _ in found]:
            raise ExportError(f"{path} does not name {item['files'][0]}.")
    if len(found) != len(manifest["items"]):
        raise ExportError(f"{path} has {len(found)} clusters; the manifest says {len(manifest['items'])}.")
    for _, density in found:
        require_agreement(path, "'PARTICLE_DENSITY'", [density], [manifest["density"]])


def _check_parameters(path: Path) -> None:
    content = _json(path)
    try:
        gravity, step, end = (float(content[name]) for name in ("GravityZ", "MaxTimeStep", "FinalTime"))
        every, reach = int(content["NeighbourSearchFrequency"]), float(content["SearchTolerance"])
        fall = float(content["BoundingBoxMaxZ"]) / 2
        materials = content["solver_settings"]["material_import_settings"]["materials_filename"]
    except (KeyError, TypeError, ValueError) as error:
        raise ExportError(f"{path} has a missing or invalid entry {error}.") from error
    require_agreement(path, "'GravityZ'", [str(gravity)], [-GRAVITY])
    require_agreement(path, "'materials_filename'", [str(materials)], [MATERIALS_NAME])
    if not 0 < step < end:
        raise ExportError(f"{path} has a time step of {step:g} s for {end:g} s.")
    if every > 1 and reach < 2 * np.sqrt(2 * GRAVITY * fall) * step * every:
        raise ExportError(
            f"{path} looks for neighbours every {every} steps and only {reach:g} m around: "
            "grains would go through each other between two searches."
        )


def _check_clusters(path: Path, manifest: Mapping[str, Any]) -> None:
    text = _balanced(path)
    places = _block(path, text, "Nodes", 4)
    elements = _block(path, text, "Elements Cluster3D", 3)
    turned = text.replace("[4] (", "").replace(")", "").replace(",", " ")
    turns = _block(path, turned, "NodalData ORIENTATION", 6)
    for rows in (places, elements, turns):
        check_count(path, len(rows), manifest)
    kinds = np.arange(len(elements)) % len(manifest["items"]) + 1
    if not np.array_equal(elements[:, 1], kinds):
        raise ExportError(f"{path} has clusters whose kinds differ from the manifest.")
    if not np.allclose(np.linalg.norm(turns[:, 2:], axis=1), 1.0, atol=1e-6):
        raise ExportError(f"{path} has orientations that are not of length 1.")


def _balanced(path: Path) -> str:
    """Return the text of an mdpa in which every block that begins also ends."""
    text = read_text(path)
    waiting: list[str] = []
    for words in (line.split() for line in text.splitlines()):
        if words[:1] == ["Begin"]:
            waiting.append(words[1])
        elif words[:1] == ["End"] and (not waiting or waiting.pop() != words[1]):
            raise ExportError(f"{path} ends '{words[1]}', which has not begun.")
    if waiting:
        raise ExportError(f"{path} does not end '{waiting[-1]}'.")
    return text


def _block(path: Path, text: str, head: str, columns: int) -> Float[np.ndarray, "rows columns"]:
    _, begun, rest = text.partition(f"\nBegin {head}\n")
    if not begun:
        raise ExportError(f"{path} lacks 'Begin {head}'.")
    return number_rows(path, rest.partition("\nEnd ")[0].splitlines(), columns)
