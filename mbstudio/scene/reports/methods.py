"""How a report's numbers were found, in a paragraph with citations that can be pasted into a paper."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import mbstudio
from mbstudio.core.metrics.factor_table import AXES
from mbstudio.core.populations.bootstrap import SAMPLES
from mbstudio.core.populations.findings import Findings
from mbstudio.core.project.measuring import ProjectPopulations

if TYPE_CHECKING:
    from mbstudio.core.project import Project

_PACKAGES = ("numpy", "scipy", "scikit-image", "trimesh")

CITATIONS = {
    "zhao": "Zhao, S. et al. (2023). Computers and Geotechnics 161, 105564.",
    "efron": "Efron, B. (1979). Bootstrap methods: another look at the jackknife. Annals of Statistics 7, "
    "1-26.",
    "holm": "Holm, S. (1979). A simple sequentially rejective multiple test procedure. Scandinavian Journal "
    "of Statistics 6, 65-70.",
    "legland": "Legland, D., Kiêu, K. & Devaux, M.-F. (2007). Computation of Minkowski measures on 2D and "
    "3D binary images. Image Analysis & Stereology 26, 83-92.",
    "masuda": "Masuda, H. & Iinoya, K. (1971). Theoretical analysis of the scatter of experimental data due "
    "to particle-size-distribution. Journal of Chemical Engineering of Japan 4, 60-66.",
    "iso13322": "ISO 13322-1:2014. Particle size analysis - Image analysis methods - Part 1: Static image "
    "analysis methods.",
    "miles": "Miles, R. E. (1974). On the elimination of edge effects in planar sampling. In: Stochastic "
    "Geometry, Wiley, 228-247.",
    "orourke": "O'Rourke, J. (1985). Finding minimal enclosing boxes. International Journal of Computer and "
    "Information Sciences 14, 183-199.",
    "wadell": "Wadell, H. (1932). Volume, shape, and roundness of rock particles. Journal of Geology 40, "
    "443-451.",
}  # fmt: skip


def describe_methods(
    project: Project, populations: ProjectPopulations, findings: Findings
) -> tuple[str, list[str]]:
    """Return a paragraph on how the numbers of a report were found, and its references."""
    grains, avatars = populations.grains, populations.avatars
    used = ["wadell", "efron", "masuda", "iso13322", "holm"]
    parts = [
        f"Grains were analysed with mbstudio {mbstudio.__version__}.",
        f"{int(grains.measured.sum())} grains were measured"
        + (f" at a voxel size of {project.grains.voxel_size}." if project.grains is not None else "."),
    ]
    if "crofton voxels" in grains.surface:
        parts.append(
            "Surface areas follow from Crofton's formula, corrected for missed chords (Legland et al. 2007)."
        )
        used.append("legland")
    elif "smoothed voxels" in grains.surface:
        parts.append(
            "Surface areas are those of the lightly smoothed surface that keeps the volume of the voxels."
        )
    parts.append(f"Axes a ≥ b ≥ c are {AXES[grains.axes].meaning[0].lower()}{AXES[grains.axes].meaning[1:]}"
                 + (" (O'Rourke 1985)." if grains.axes == "obb" else "."))  # fmt: skip
    if grains.axes == "obb":
        used.append("orourke")
    parts.append(
        "Sphericity is that of Wadell (1932). Size distributions are by mass at one density, with the "
        "intermediate axis as size."
    )
    if findings.is_corrected:
        parts.append(
            "Grains that the border of the scan cuts were corrected for after Miles and Lantuéjoul (1974)."
        )
        used.append("miles")
    parts.append(
        f"Intervals of {100 * findings.level:g} % were found by drawing the grains again {SAMPLES} times "
        "(Efron 1979); numbers of grains needed follow ISO 13322-1 (Masuda & Iinoya 1971) and the intervals. "
        "Probabilities of differences were adjusted for the number of factors (Holm 1979)."
    )
    if avatars is not None:
        parts.append(f"{len(avatars)} metaball avatars (Zhao et al. 2023) were fitted to the grains.")
        used.append("zhao")
    return " ".join(parts), [CITATIONS[name] for name in sorted(used, key=lambda name: CITATIONS[name])]


def repeat_record(project: Project, populations: ProjectPopulations, findings: Findings) -> dict[str, Any]:
    """Return what is needed to repeat a report: versions, scan and its digest, settings and seeds."""
    state = project.state
    reference = state.scan
    fits = state.fit_settings
    return {
        "mbstudio": mbstudio.__version__,
        "python": platform.python_version(),
        "packages": {name: version(name) for name in _PACKAGES},
        "scan": None if reference is None else {
            "file": None if reference.path is None else reference.path.name,
            "sha256": reference.digest, "shape_zyx": list(reference.shape), "dtype": reference.dtype,
            "voxel_size": str(reference.voxel_size),
            "part": None if reference.excerpt is None else reference.excerpt.describe(),
        },
        "segmentation": None if state.segmentation is None else {
            name: value if isinstance(value, int | float | str | bool | None) else str(value)
            for name, value in vars(state.segmentation).items()
        },
        "edits_by_hand": 0 if project.grains is None else len(project.grains.edits),
        "fits": {"n": fits.n, "method": fits.method, "seed": fits.seed, "options": dict(fits.options),
                 "target": fits.target},
        "measured": {
            "grains": populations.grains.labels.tolist(), "axes": populations.grains.axes,
            "surface": populations.grains.surface, "unit": populations.grains.unit,
        },
        "bootstrap": {"samples": SAMPLES, "level": findings.level, "seed": findings.seed,
                      "precision": findings.precision},
    }  # fmt: skip
