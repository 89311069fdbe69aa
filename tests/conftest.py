"""The frame of the suite: headless rendering set before any Qt or VTK import, shared fixtures.

``--full`` also runs the slow tests, and hypothesis with other
examples each time. Tests marked ``gl`` drive the real OpenGL viewport and need
an X server: ``tests/test_gl_suite.py`` runs them in a pytest of their own under Xvfb, which sets
``MBSTUDIO_GL_TESTS``; in the ordinary run they are skipped.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED_DATA = REPOSITORY.parent / "shared" / "data"
UNDER_XVFB = bool(os.environ.get("MBSTUDIO_GL_TESTS"))


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _set_headless_environment() -> None:
    os.environ["MPLBACKEND"] = "Agg"
    os.environ["PYVISTA_OFF_SCREEN"] = "true"
    # What scikit-learn sets for itself when a test first needs it.
    os.environ.setdefault("KMP_DUPLICATE_LIB_OK", "True")
    os.environ.setdefault("KMP_INIT_AT_FORK", "FALSE")
    # Settings and recent files of the person who runs the suite stay untouched.
    home = tempfile.mkdtemp(prefix="mbstudio-tests-")
    for variable in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"):
        os.environ[variable] = str(Path(home) / variable.lower())
    if UNDER_XVFB:
        os.environ["QT_QPA_PLATFORM"] = "xcb"
        os.environ.pop("VTK_DEFAULT_OPENGL_WINDOW", None)
        os.environ.pop("PYVISTA_OFF_SCREEN", None)
        return
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    if sys.platform.startswith("linux"):
        # OSMesa left Mesa in 25.1; EGL renders without a display as well.
        window = "vtkOSOpenGLRenderWindow" if _loads("libOSMesa.so.8") else "vtkEGLRenderWindow"
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window


for _module in ("PySide6", "vtkmodules", "pyvista"):
    if _module in sys.modules:
        raise RuntimeError(f"{_module} was imported before tests/conftest.py set the headless environment.")
_set_headless_environment()

hypothesis.settings.register_profile("repeatable", deadline=None, derandomize=True, database=None)
hypothesis.settings.register_profile("random", deadline=None)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="also run the tests that are slow or large")
    parser.addoption("--images", metavar="FOLDER", help="keep the pictures of the window's stations there")


def pytest_configure(config: pytest.Config) -> None:
    hypothesis.settings.load_profile("random" if config.getoption("--full") else "repeatable")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    skip_full = pytest.mark.skip(reason="slow or large: run with --full")
    skip_gl = pytest.mark.skip(reason="needs an X server: run under Xvfb by tests/test_gl_suite.py")
    for item in items:
        if "full" in item.keywords and not config.getoption("--full"):
            item.add_marker(skip_full)
        if "gl" in item.keywords and not UNDER_XVFB:
            item.add_marker(skip_gl)


_SET_BY_LIBRARIES = ("PYTEST_CURRENT_TEST", "KMP_", "TORCHINDUCTOR_")


@pytest.fixture(autouse=True)
def _environment_stays_as_it_was() -> Iterator[None]:
    """Fail a test that leaves an environment variable behind, which would steer the tests after it."""
    before = _environment()
    yield
    after = _environment()
    changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    for name in changed:
        os.environ.pop(name, None)
        if name in before:
            os.environ[name] = before[name]
    assert not changed, f"The test changed the environment: {', '.join(changed)}."


def _environment() -> dict[str, str]:
    # What scikit-learn and torch set when they are first used is no test's doing.
    return {name: value for name, value in os.environ.items() if not name.startswith(_SET_BY_LIBRARIES)}


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root of the repository."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real grains and scans, which are no part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the real grains and scans are not there: {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture(scope="session")
def edit_project() -> Callable[[Path], AbstractContextManager[Any]]:
    """Open a project file as HDF5 to change it; it is sealed anew at the end, as a stranger would do it."""
    import h5py

    from mbstudio.core.sealing import seal_image

    @contextmanager
    def edit(path: Path) -> Iterator[Any]:
        with h5py.File(path, "r+") as file:
            yield file
        content = bytearray(path.read_bytes())
        seal_image(content)
        path.write_bytes(content)

    return edit


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed, fresh for each test."""
    return np.random.default_rng(20230607)


@pytest.fixture(scope="session")
def small_scan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A TIFF of 56 cubed voxels with three grains apart from each other and one cut by the border.

    The grains that are whole: ellipsoids of semi-axes 12, 10 and 9; 11, 9 and 12; 8, 11 and 9
    voxels. The file does not tell its voxel size.
    """
    import tifffile

    z, y, x = np.mgrid[:56, :56, :56]
    scan = np.full((56, 56, 56), 10_000.0)
    for centre, axes in (
        ((15, 15, 15), (12, 10, 9)),
        ((38, 40, 16), (11, 9, 12)),
        ((18, 38, 41), (8, 11, 9)),
        ((44, 12, 50), (9, 9, 9)),
    ):
        distance = np.sqrt(sum(((c - m) / a) ** 2 for c, m, a in zip((z, y, x), centre, axes, strict=True)))
        # Partial volume: the grey value passes from void to grain within about a voxel.
        scan += 30_000 / (1 + np.exp(25 * (distance - 1)))
    scan += np.random.default_rng(1).normal(0, 400, scan.shape)
    path = tmp_path_factory.mktemp("scan") / "small.tif"
    tifffile.imwrite(path, scan.clip(0, 65535).astype(np.uint16), photometric="minisblack")
    return path


@pytest.fixture
def read_only_folder(tmp_path: Path) -> Iterator[Path]:
    """A folder in which nothing can be made, not even by root, to whom permissions mean nothing."""
    folder = tmp_path / "read-only"
    folder.mkdir()
    folder.chmod(0o500)
    # Root cannot write into the kernel's own files, where they are mounted.
    for candidate in (folder, Path("/sys/kernel")):
        try:
            (candidate / "trial").touch()
        except OSError:
            yield candidate
            break
        (candidate / "trial").unlink()
    else:
        pytest.skip("no folder here is read-only for this user")
    folder.chmod(0o700)
