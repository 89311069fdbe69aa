"""The window under test: its own settings, closed without questions, nothing left alive."""

from __future__ import annotations

import gc
import threading
import time
import weakref

import numpy as np
import pytest
import tifffile
from PySide6.QtCore import QCoreApplication, QEvent, QSettings, QTimer
from PySide6.QtWidgets import QApplication
from shiboken6 import isValid
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow

from mbstudio.core.grains import load_labels
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.meaning import Meanings
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.theme import Theme
from mbstudio.ui.viewport import Viewport
from tests.core.vae.boxes import boxes

PATIENCE = 120_000  # milliseconds that a test waits for work before it gives up


def delete_later_now():
    """Run what waits for deletion: processEvents does not."""
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    QCoreApplication.processEvents()


@pytest.fixture(scope="module", autouse=True)
def known_objects():
    """Set aside what imports and other files have made: nothing need look at it after each test.

    Files come in any order after others, whose imports leave a million objects.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()


def living():
    """Return viewports, VTK's windows and renderers, running timers and top-level widgets that are alive."""
    found = []
    for thing in gc.get_objects():
        # Of the type itself: a weak proxy passes isinstance as well.
        kind = type(thing)
        if issubclass(kind, vtkRenderWindow | vtkRenderer) or (
            issubclass(kind, Viewport | QTimer)
            and isValid(thing)
            and (kind is not QTimer or thing.isActive())
        ):
            found.append(thing)
    return found + list(QApplication.topLevelWidgets())


FAILED = pytest.StashKey[bool]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    item.stash[FAILED] = item.stash.get(FAILED, False) or report.failed
    return report


@pytest.fixture(autouse=True)
def nothing_left(qapp, request):
    """Fail a test that leaves a viewport, a VTK window, a thread, a running timer or a widget behind."""
    threads = set(threading.enumerate())
    known = weakref.WeakSet(living())
    yield
    if request.node.stash.get(FAILED, False):
        return  # its traceback keeps everything alive, and there is one failure to look at already
    # What the test was given is closed by now, but pytest still holds it.
    request.node.funcargs.clear()
    deadline = time.monotonic() + 3
    while True:
        delete_later_now()
        gc.collect()
        left = [thread.name for thread in threading.enumerate() if thread not in threads]
        left += [repr(thing) for thing in living() if thing not in known]
        if not left or time.monotonic() > deadline:
            break
        time.sleep(0.05)
    assert not left, f"left alive: {left}"


@pytest.fixture(autouse=True)
def state_folder(tmp_path_factory, monkeypatch):
    """Autosaves of a test are its own, and not among the files that it looks at."""
    folder = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


@pytest.fixture
def settings(tmp_path):
    return QSettings(str(tmp_path / "settings.ini"), QSettings.Format.IniFormat)


@pytest.fixture
def theme(qapp, settings):
    theme = Theme(settings)
    yield theme
    theme.deleteLater()
    delete_later_now()


@pytest.fixture
def window(qtbot, settings, theme):
    window = MainWindow(settings, theme)
    window.project_files.asks = False
    window.stations.fit.work.shows_spheres = False
    window.resize(1280, 800)
    window.show()
    qtbot.waitExposed(window)
    yield window
    window.close()
    assert window.queue.is_idle or window.queue.shut_down()
    window.deleteLater()
    delete_later_now()
    gc.collect()


@pytest.fixture
def idle(qtbot, window):
    """Wait until no task runs or waits and the view is drawn."""

    def wait():
        qtbot.waitUntil(lambda: window.queue.is_idle, timeout=PATIENCE)
        for _ in range(3):
            QCoreApplication.processEvents()

    return wait


def ellipsoid(shape, centre, radii):
    z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
    return sum(((axis - c) / r) ** 2 for axis, c, r in zip((z, y, x), centre, radii, strict=True)) <= 1


@pytest.fixture(scope="session")
def scan_path(tmp_path_factory):
    """A scan of 64 cubed: two grains inside and one that the edge cuts, with noise."""
    shape = (64, 64, 64)
    grains = (
        ellipsoid(shape, (20, 22, 22), (11, 13, 10))
        | ellipsoid(shape, (42, 42, 40), (12, 10, 14))
        | ellipsoid(shape, (60, 14, 50), (9, 9, 9))
    )
    noise = np.random.default_rng(7).normal(0, 500, shape)
    grey = np.where(grains, 30_000, 8_000) + noise
    path = tmp_path_factory.mktemp("scan") / "three_grains.tif"
    tifffile.imwrite(path, grey.astype(np.uint16))
    return path


@pytest.fixture
def scanned(window, idle, scan_path):
    """The window with the scan opened."""
    window.stations.scan.work.open(scan_path, "14 um")
    idle()
    return window


@pytest.fixture
def segmented(scanned, idle):
    """The window with its three grains found."""
    assert scanned.commands.run("grains.find")
    idle()
    return scanned


@pytest.fixture(scope="session")
def two_grains():
    """Two ellipsoids of 10 µm voxels, neither cut by the edge, without a scan."""
    shape = (56, 56, 56)
    labels = ellipsoid(shape, (15, 15, 15), (9, 10, 8)).astype(np.int32)
    labels[ellipsoid(shape, (38, 38, 38), (8, 12, 10))] = 2
    return load_labels(labels, voxel_size="10 um")


@pytest.fixture
def with_grains(window, idle, two_grains):
    """The window with two grains, and no scan that would have to be segmented."""
    window.workspace.replace_project(Project(ProjectState(grains=two_grains)))
    idle()
    return window


@pytest.fixture(scope="session")
def learner():
    """A style-learner of boxes."""
    return learn(boxes(20, np.random.default_rng(2)), preset="pca", seed=0)


@pytest.fixture(scope="session")
def meanings(learner):
    return Meanings.measure(learner)


@pytest.fixture
def rest(qtbot, window, idle):
    """Wait until nothing is being shown, learned or drawn any more."""

    def wait():
        for _ in range(2):
            idle()
            qtbot.waitUntil(lambda: window.stations.latent.work.live.is_idle, timeout=PATIENCE)
            QCoreApplication.processEvents()

    return wait


@pytest.fixture
def shaping(window, rest, learner, meanings, monkeypatch):
    """The window at station Latent with a style-learner; its meanings are learned once for all tests."""
    monkeypatch.setattr(Meanings, "measure", lambda *_, **__: meanings)
    window.enter("latent")
    window.workspace.use_style(learner)
    rest()
    return window
