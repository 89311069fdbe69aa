"""``mbstudio doctor``: what this machine offers."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
from typing import Any

import mbstudio
from mbstudio.cli import console, inputs

PACKAGES = (
    "numpy", "scipy", "scikit-image", "numba", "h5py", "trimesh", "manifold3d", "pyvista", "vtk",
    "PySide6-Essentials", "pyvistaqt", "torch",
)  # fmt: skip
SECONDS_FOR_OPENGL = 60

# Run on its own: a broken OpenGL ends the process that tries it.
_ASK_OPENGL = """
import json
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import vtkRenderWindow, vtkRenderer
from vtkmodules.vtkRenderingOpenGL2 import vtkTextureObject
window = vtkRenderWindow()
window.SetOffScreenRendering(1)
window.SetSize(64, 64)
window.AddRenderer(vtkRenderer())
window.Render()
found = {"window": window.GetClassName()}
for line in window.ReportCapabilities().splitlines():
    name, colon, value = line.partition(" string:")
    if colon and name.startswith("OpenGL "):
        found[name.removeprefix("OpenGL ")] = value.strip()
found["largest_3d_texture"] = vtkTextureObject.GetMaximumTextureSize3D(window)
print("FOUND" + json.dumps(found))
"""


HELP = "Show versions, OpenGL, the device of PyTorch, and the DEM engines that are found."


def doctor(as_json: inputs.JsonOption = False) -> None:
    """Run ``mbstudio doctor``; `HELP` says what it does."""
    result = {
        "mbstudio": mbstudio.__version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "cores": usable_cores(),
        "memory_gib": memory_gib(),
        "display": _display(),
        "opengl": ask_opengl(),
        "torch_device": torch_device(),
        "packages": {name: version_of(name) for name in PACKAGES},
        "engines": find_engines(),
    }
    if as_json:
        console.print_json(result)
        return
    nested = {"opengl", "packages", "engines"}
    console.print_facts("This machine", {name: value for name, value in result.items() if name not in nested})
    for title, key in (("OpenGL", "opengl"), ("Packages", "packages"), ("DEM engines", "engines")):
        print()
        facts: Any = result[key]
        console.print_facts(
            title, {name: "not found" if value is None else value for name, value in facts.items()}
        )


def _display() -> str:
    from mbstudio.scene.pictures.offscreen import has_display

    return "yes" if has_display() else "none: pictures are rendered in memory"


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def memory_gib() -> float | None:
    """Return the machine's memory, None where the system does not tell it in POSIX's way."""
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return None
    return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30, 1)


def version_of(package: str) -> str | None:
    """Return the version of an installed package, None if it is not there."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def ask_opengl() -> dict[str, Any]:
    """Render a picture in a process of its own; tell by what, or why it failed."""
    from mbstudio.scene.pictures.offscreen import prepare_offscreen_rendering

    prepare_offscreen_rendering()
    try:
        run = subprocess.run(
            [sys.executable, "-c", _ASK_OPENGL], capture_output=True, text=True, timeout=SECONDS_FOR_OPENGL
        )
    except subprocess.TimeoutExpired:
        return {"error": f"no picture within {SECONDS_FOR_OPENGL} s"}
    for line in run.stdout.splitlines():
        if line.startswith("FOUND"):
            found: dict[str, Any] = json.loads(line.removeprefix("FOUND"))
            return found
    last = run.stderr.strip().splitlines()[-1:] or ["no message"]
    return {"error": f"rendering failed (code {run.returncode}): {last[0]}"}


def torch_device() -> str:
    """Return what PyTorch would compute on."""
    if importlib.util.find_spec("torch") is None:
        return "PyTorch is not installed"
    import torch

    if torch.cuda.is_available():
        return f"cuda: {torch.cuda.get_device_name(0)}"
    if torch.backends.mps.is_available():
        return "mps"
    return "cpu"


def find_engines() -> dict[str, str | None]:
    """Return where each optional DEM engine is, None where it is not."""
    from mbstudio.core.dem import engines

    found: dict[str, str | None] = {}
    for name in engines.engine_names():
        command = engines.find_engine(name)
        module = engines.MODULES.get(name)
        if command is None:
            found[name] = None
        else:
            found[name] = f"Python module {module} of {command[0]}" if module else command[0]
    return found
