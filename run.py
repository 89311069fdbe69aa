#!/usr/bin/env python3
"""Set up mbstudio on a bare machine and start it. Needs Python 3.11 or newer, nothing else.

    python3 run.py                 set up, then the window on the built-in sample scan
                                   (without a display: mbstudio tour --out tour/)
    python3 run.py ARGUMENTS       set up, then `mbstudio ARGUMENTS`
    python3 run.py test [...]      set up with the test tools, then pytest, headless; with --cov it
                                   also reports which lines of mbstudio the tests have run
    python3 run.py check           set up with the test tools, then ruff (rules, layout) and mypy

Everything goes into .venv beside this file, in the versions of constraints.txt. A stamp is
written into .venv last of all: without it, .venv is made anew, so that an interrupted set-up
is never trusted.
"""

from __future__ import annotations

import sys

if sys.version_info < (3, 11):  # noqa: UP036 - whoever starts this may have an older one
    sys.exit(
        f"mbstudio needs Python 3.11 or newer; this is Python {sys.version_info[0]}.{sys.version_info[1]} "
        f"({sys.executable}).\nStart it with a newer one, for example: python3.12 run.py"
    )

import contextlib
import ctypes
import hashlib
import importlib.util
import json
import os
import platform
import secrets
import shlex
import shutil
import subprocess
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent
SET_UP_VERSION = 1  # raise it when the steps below change, so that every .venv is made anew
KINDS = {"runtime": "", "test": "[test]"}
# What `check` runs, each as `python -m ...`.
CHECKS = (("ruff", "check"), ("ruff", "format", "--check"), ("mypy",))
MARKER = "made-by-mbstudio"
STAMP = "mbstudio-set-up.json"
# Set on some machines; each of them makes pip install somewhere else than into .venv.
MISLEADING_VARIABLES = {"PYTHONHOME", "PYTHONPATH", "PIP_USER", "PIP_TARGET", "PIP_PREFIX"}


class SetUpError(Exception):
    """Why the set-up cannot go on, in words for the user."""


def say(message: str) -> None:
    print(f"mbstudio set-up: {message}", file=sys.stderr, flush=True)


# ---------------------------------------------------------------- system libraries (Linux)


class Need(NamedTuple):
    """A library or program of the system, and the Debian package that brings it."""

    name: str
    package: str
    alternative: str = ""  # does as well where the package is not to be had
    optional: bool = False  # the program works without it


PROGRAM_NEEDS = (
    Need("ensurepip", "python3-venv"),  # Debian's Python comes without it
    Need("libOSMesa.so.8", "libosmesa6", alternative="libEGL.so.1"),
    Need("libEGL.so.1", "libegl1"),
    Need("libGL.so.1", "libgl1"),
    Need("libOpenGL.so.0", "libopengl0"),
    Need("libglib-2.0.so.0", "libglib2.0-0"),
    Need("libdbus-1.so.3", "libdbus-1-3"),
    Need("libfontconfig.so.1", "libfontconfig1"),
    Need("libxkbcommon.so.0", "libxkbcommon0"),
)
WINDOW_NEEDS = (
    Need("libxkbcommon-x11.so.0", "libxkbcommon-x11-0"),
    Need("libxcb-cursor.so.0", "libxcb-cursor0"),
    Need("libxcb-icccm.so.4", "libxcb-icccm4"),
    Need("libxcb-image.so.0", "libxcb-image0"),
    Need("libxcb-keysyms.so.1", "libxcb-keysyms1"),
    Need("libxcb-randr.so.0", "libxcb-randr0"),
    Need("libxcb-render-util.so.0", "libxcb-render-util0"),
    Need("libxcb-shape.so.0", "libxcb-shape0"),
    Need("libxcb-xinerama.so.0", "libxcb-xinerama0"),
    Need("libxcb-xfixes.so.0", "libxcb-xfixes0"),
)
# Tests that need these are skipped by name where they are missing.
TEST_NEEDS = (
    *(need._replace(optional=True) for need in WINDOW_NEEDS),
    Need("xvfb-run", "xvfb", optional=True),
    Need("xauth", "xauth", optional=True),
    Need("liggghts", "liggghts", optional=True),
    Need("lmp", "lammps", optional=True),
)
# DEM engines that the tests run, by the programs above and by the packages of the extra `test`.
ENGINE_PROGRAMS = {"LIGGGHTS": "liggghts", "LAMMPS": "lmp"}
ENGINE_PACKAGES = {"Kratos": (3, 14), "peclet-dem": (3, 14)}  # and the last Python that has them
EXPECTED_ENGINES = "MBSTUDIO_EXPECTED_ENGINES"
OTHER_PYTHON = "MBSTUDIO_ENGINES_PYTHON"


def is_present(name: str) -> bool:
    """Return whether a library loads, a program is found, or Python's own module is there."""
    if name == "ensurepip":
        return importlib.util.find_spec(name) is not None
    if ".so" not in name:
        return shutil.which(name) is not None
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def engines_of_set_up(present: Callable[[str], bool] = is_present) -> list[str]:
    """Return the DEM engines that the set-up has brought or found: their tests must not be skipped."""
    engines = [name for name, program in ENGINE_PROGRAMS.items() if present(program)]
    fitting = sys.platform == "linux" and platform.machine() == "x86_64"
    if fitting and not os.environ.get(OTHER_PYTHON):
        engines += [name for name, last in ENGINE_PACKAGES.items() if sys.version_info[:2] <= last]
    return engines


def missing_needs(needs: Sequence[Need], present: Callable[[str], bool] = is_present) -> list[Need]:
    """Return what is not there, whether or not an alternative is."""
    return [need for need in needs if not present(need.name)]


def is_needed(need: Need, present: Callable[[str], bool] = is_present) -> bool:
    """Return whether mbstudio cannot work without what is missing."""
    return not need.optional and not (need.alternative and present(need.alternative))


def install_command(packages: Sequence[str]) -> list[str]:
    return ["apt-get", "install", "-y", "--no-install-recommends", *packages]


def advice(missing: Sequence[Need]) -> str:
    """Return the one command that brings what is missing, for the user to run."""
    packages = [need.package for need in missing]
    if shutil.which("apt-get"):
        return f"sudo apt-get update && sudo {shlex.join(install_command(packages))}"
    libraries = [need.name for need in missing if ".so" in need.name]
    if shutil.which("dnf"):
        return "sudo dnf install " + " ".join(f"'{library}()(64bit)'" for library in libraries)
    return f"install these libraries with the system's package manager: {' '.join(libraries)}"


def has_display() -> bool:
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def needs_of(kind: str) -> list[Need]:
    needs = list(PROGRAM_NEEDS)
    if kind == "test":
        needs += TEST_NEEDS
    elif has_display():
        needs += WINDOW_NEEDS
    return needs


def provide_system_libraries(kind: str, *, install: bool) -> None:
    """Install what is missing as root on Debian and its kin, else tell the one command to run.

    Raises
    ------
    SetUpError
        If something that mbstudio cannot work without is still missing.
    """
    missing = missing_needs(needs_of(kind))
    if not missing or not (install or any(is_needed(need) for need in missing)):
        return
    if os.geteuid() == 0 and shutil.which("apt-get"):
        install_packages(missing)
        importlib.invalidate_caches()
        missing = missing_needs(needs_of(kind))
    lacking = [need for need in missing if is_needed(need)]
    if lacking:
        names = ", ".join(need.name for need in lacking)
        raise SetUpError(f"the system lacks {names}. Run this, then start again:\n\n    {advice(missing)}\n")
    without = [need for need in missing if need.optional]
    if without:
        say(f"without {', '.join(need.name for need in without)} some tests are skipped. To run them all:")
        say(f"    {advice(without)}")


def install_packages(missing: Sequence[Need]) -> None:
    """Install Debian packages; those that the distribution does not have are left out."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    say("refreshing the list of system packages (apt-get update)")
    if subprocess.run(["apt-get", "update", "-qq"], env=environment, stdout=sys.stderr).returncode:
        say("apt-get update failed: going on with the list that is there.")
    known = []
    for need in missing:
        found = subprocess.run(
            ["apt-get", "install", "--simulate", "-qq", need.package], env=environment, capture_output=True
        )
        if found.returncode == 0:
            known.append(need.package)
        else:
            say(f"the package {need.package} is not to be had in this distribution.")
    if not known:
        return
    say(f"installing system packages: {' '.join(known)}")
    command = [*install_command(known), "-qq", "-o", "DPkg::Lock::Timeout=300"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        say(f"apt-get install failed:\n{done.stdout}{done.stderr}")


# ---------------------------------------------------------------- the virtual environment


def fingerprint(root: Path) -> str:
    """Return a digest of all that decides what belongs in .venv."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    parts = {
        "set_up": SET_UP_VERSION,
        "place": str(root),  # the scripts in a .venv hold its absolute path
        "build": project["build-system"],
        "dependencies": project["project"]["dependencies"],
        "extras": project["project"]["optional-dependencies"],
        "scripts": project["project"]["scripts"],
        "constraints": (root / "constraints.txt").read_text(encoding="utf-8"),
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def stamped_kinds(venv: Path, expected: str) -> set[str]:
    """Return what a .venv is known to hold whole; nothing if its stamp is not the expected one."""
    try:
        stamp = json.loads((venv / STAMP).read_text(encoding="utf-8"))
        sound = stamp["fingerprint"] == expected and Path(stamp["interpreter"]).exists()
        return set(stamp["kinds"]) if sound and python_of(venv).exists() else set()
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def write_stamp(venv: Path, expected: str, kinds: set[str]) -> None:
    """Write the stamp as the very last step, on the disk before its name is."""
    stamp = {
        "fingerprint": expected,
        "interpreter": str(Path(sys.executable).resolve()),
        "kinds": sorted(kinds),
    }
    temporary = venv / f"{STAMP}.part"
    with temporary.open("w", encoding="utf-8") as stream:
        json.dump(stamp, stream)
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(venv / STAMP)


def python_of(venv: Path) -> Path:
    return venv / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def discard(venv: Path) -> None:
    """Remove a .venv that cannot be trusted, if it is ours.

    It is renamed first: a removal that is interrupted must not leave a .venv behind.
    """
    if venv.exists():
        if not (venv / MARKER).exists() and any(venv.iterdir()):
            raise SetUpError(f"{venv} was not made by run.py: move it away or remove it, then start again.")
        venv.rename(venv.with_name(f".venv-discarded-{secrets.token_hex(4)}"))
    for leftover in venv.parent.glob(".venv-discarded-*"):
        shutil.rmtree(leftover, ignore_errors=True)


@contextlib.contextmanager
def only_one(root: Path) -> Iterator[int]:
    """Let one set-up run at a time. The lock is passed on to pip: should this process be
    killed, the next set-up waits until that pip has ended, too."""
    with (root / ".venv.lock").open("a+b") as stream:
        if os.name == "nt":
            import msvcrt

            stream.seek(0)
            msvcrt.locking(stream.fileno(), msvcrt.LK_LOCK, 1)  # type: ignore[attr-defined]
        else:
            import fcntl

            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                say("another set-up is running: waiting for it to end")
                fcntl.flock(stream, fcntl.LOCK_EX)
        yield stream.fileno()


def run_step(command: Sequence[str | Path], root: Path, lock: int) -> None:
    """Run one step of the set-up; SetUpError if it fails."""
    environment = {name: value for name, value in os.environ.items() if name not in MISLEADING_VARIABLES}
    # The tools that build the package are pinned as well; older pips read the first variable.
    environment["PIP_CONSTRAINT"] = environment["PIP_BUILD_CONSTRAINT"] = str(root / "constraints.txt")
    environment["PIP_DISABLE_PIP_VERSION_CHECK"] = "1"
    pass_on = {} if os.name == "nt" else {"pass_fds": (lock,)}
    words = [str(word) for word in command]
    result = subprocess.run(words, cwd=root, env=environment, stdout=sys.stderr, **pass_on)
    if result.returncode:
        raise SetUpError(
            f"this step failed (see above): {shlex.join(words)}\n"
            "Check the network and the free space on the disk, then start again."
        )


def build(root: Path, kind: str, expected: str, lock: int) -> None:
    """Make .venv, or add to a whole one what another kind needs."""
    venv = root / ".venv"
    kinds = stamped_kinds(venv, expected)
    if not kinds:
        if venv.exists():
            say("the .venv here is unfinished or out of date: making it anew")
        discard(venv)
        say(f"creating {venv} with Python {sys.version.split()[0]}")
        venv.mkdir()
        (venv / MARKER).touch()
        run_step([sys.executable, "-m", "venv", venv], root, lock)
    (venv / STAMP).unlink(missing_ok=True)
    purpose = "the tests" if kind == "test" else "the program"
    say(f"installing the packages for {purpose}; this takes some minutes")
    quiet = [] if sys.stderr.isatty() else ["--quiet"]
    run_step([python_of(venv), "-m", "pip", "install", *quiet, "-e", f".{KINDS[kind]}"], root, lock)
    kinds |= {"runtime", kind}
    write_stamp(venv, expected, kinds)
    say("done")


def set_up(kind: str, root: Path = ROOT) -> Path:
    """Make sure that .venv holds all that `kind` needs; return its interpreter."""
    expected = fingerprint(root)
    venv = root / ".venv"
    ready = kind in stamped_kinds(venv, expected)
    if sys.platform.startswith("linux"):
        provide_system_libraries(kind, install=not ready)
    if not ready:
        with only_one(root) as lock:
            if kind not in stamped_kinds(venv, expected):  # another start may have done it meanwhile
                build(root, kind, expected, lock)
    return python_of(venv)


# ---------------------------------------------------------------- start


def pytest_arguments(arguments: Sequence[str]) -> list[str]:
    """Return what pytest gets: the whole suite runs on two cores, a part as with pytest alone (--pdb, -x).

    A bare ``--cov`` would take the word after it for what is to be measured.
    """
    words = ["--cov=mbstudio" if word == "--cov" else word for word in arguments]
    is_whole_suite = all(word.startswith("--cov") for word in words)
    return [*words, *(["-n", "2", "--dist", "loadfile"] if is_whole_suite else [])]


def check(python: Path) -> int:
    """Run every check, also after one that fails; return 0 if all pass, else 1."""
    failed = []
    for words in CHECKS:
        say(f"running {shlex.join(words)}")
        if subprocess.run([str(python), "-m", *words], cwd=ROOT).returncode:
            failed.append(shlex.join(words))
    if failed:
        say(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


def command_of(arguments: Sequence[str], python: Path) -> list[str]:
    """Return what to run once the set-up is done."""
    if arguments[:1] == ["test"]:
        return [str(python), "-m", "pytest", *pytest_arguments(arguments[1:])]
    if not arguments:
        arguments = ["gui", "--sample"] if has_display() else ["tour", "--out", "tour/"]
    return [str(python), "-m", "mbstudio", *arguments]


def main(arguments: Sequence[str]) -> int:
    is_check = list(arguments) == ["check"]
    is_test = list(arguments[:1]) == ["test"]
    try:
        python = set_up("test" if is_test or is_check else "runtime")
    except (SetUpError, OSError) as error:
        say(str(error))
        return 1
    if is_check:
        return check(python)
    command = command_of(list(arguments), python)
    if is_test:
        os.chdir(ROOT)
        os.environ[EXPECTED_ENGINES] = ",".join(engines_of_set_up())
    if os.name == "nt":
        return subprocess.run(command).returncode
    sys.stdout.flush()
    os.execv(command[0], command)


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        say("interrupted; the next start goes on from the beginning.")
        sys.exit(130)
