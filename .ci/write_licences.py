"""Writes docs/licences.md: the licence of every package that mbstudio installs, as its metadata state it.

    python .ci/write_licences.py

``tests/test_lock.py`` checks that the page agrees with what is installed.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs" / "licences.md"
_LONGEST = 60
_COPYLEFT = re.compile(r"GPL|Lesser General|MPL|Mozilla", re.IGNORECASE)
_HEAD = """# Licences

mbstudio is under the [MIT licence](../LICENSE). It installs these packages, which keep their own. The
table is what their metadata state; `python .ci/write_licences.py` writes it anew.

"""
_TAIL = """
**Under the LGPL** are Qt and its Python binding PySide6 with shiboken6 (LGPL 3, offered beside GPL 2 and
3), and connected-components-3d, edt, fastremap and fill_voids (LGPL 3), which label and measure voxels.
mbstudio uses them unchanged, as packages of their own that anybody can exchange; who hands on mbstudio
together with them passes on the LGPL's text and this freedom. certifi is under the MPL 2. Wheels also
hold libraries in machine code with licences of their own, which stand beside them in the folders
`*.dist-info`: GEOS (LGPL 2.1) in shapely, for example.

Not installed by mbstudio unless asked for: what the extras `mp4` (imageio-ffmpeg brings FFmpeg, under
LGPL or GPL as it was built), `parquet`, `engines` and `benchmark` name; the packages of `benchmark` are
mostly under the GPL. Tests bring tools of their own. None of these is a part of mbstudio.
"""


def installed() -> list[Distribution]:
    """Return what mbstudio's dependencies bring in this environment, by name."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: dict[str, Distribution] = {}
    waiting = [Requirement(text) for text in project["dependencies"]]
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if name in found or (wanted.marker and not _applies(wanted)):
            continue
        try:
            found[name] = distribution(wanted.name)
        except PackageNotFoundError:
            continue
        waiting += [Requirement(text) for text in found[name].requires or []]
    return [found[name] for name in sorted(found)]


def _applies(wanted: Requirement) -> bool:
    return wanted.marker is None or wanted.marker.evaluate({"extra": ""})


def licence_of(package: Distribution) -> str:
    """Return what a package's metadata state as its licence."""
    told = package.metadata
    if expression := told.get("License-Expression"):
        return str(expression)
    classified = [
        text.rpartition(" :: ")[2] for text in told.get_all("Classifier", []) if text.startswith("License ::")
    ]
    stated = (str(told.get("License") or "").strip().splitlines() or [""])[0].strip()
    if classified and classified != ["OSI Approved"]:
        return ", ".join(classified)
    return stated if 0 < len(stated) <= _LONGEST else "see the package"


def table_of(packages: Iterable[Distribution]) -> str:
    """Return the table of the page; what asks more of who hands it on than a notice stands in bold."""
    rows = ["| Package | Licence |", "|---|---|"]
    for package in packages:
        licence = licence_of(package)
        shown = f"**{licence}**" if _COPYLEFT.search(licence) else licence
        rows.append(f"| {package.metadata['Name']} | {shown} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    PAGE.write_text(_HEAD + table_of(installed()) + _TAIL, encoding="utf-8")
