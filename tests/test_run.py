"""run.py: what it finds missing, what it tells, and that it trusts no half-made .venv."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture
def run():
    spec = importlib.util.spec_from_file_location("run", REPOSITORY / "run.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def root(tmp_path):
    """A place that looks like the repository."""
    for name in ("pyproject.toml", "constraints.txt"):
        shutil.copy(REPOSITORY / name, tmp_path / name)
    return tmp_path


@pytest.fixture
def steps(run, monkeypatch):
    """Stands in for pip and venv: what was run, and a .venv that looks whole."""
    done = []

    def step(command, root, lock):
        words = [str(word) for word in command]
        done.append(words)
        if "venv" in words:
            python = run.python_of(root / ".venv")
            python.parent.mkdir(parents=True)
            python.touch()

    monkeypatch.setattr(run, "run_step", step)
    monkeypatch.setattr(run, "provide_system_libraries", lambda kind, install: None)
    return done


def installs(steps):
    return [words[-1] for words in steps if "pip" in words]


# ------------------------------------------------------------------ the virtual environment


def test_the_first_start_makes_the_environment_and_the_second_does_nothing(run, root, steps):
    run.set_up("runtime", root)
    assert installs(steps) == ["."]
    run.set_up("runtime", root)
    assert installs(steps) == ["."]


def test_the_tests_add_to_the_environment_and_both_stay_ready(run, root, steps):
    run.set_up("runtime", root)
    run.set_up("test", root)
    assert installs(steps) == [".", ".[test]"]
    assert sum("venv" in words for words in steps) == 1
    run.set_up("runtime", root)
    run.set_up("test", root)
    assert len(installs(steps)) == 2


def test_an_environment_for_the_tests_runs_the_program_too(run, root, steps):
    run.set_up("test", root)
    run.set_up("runtime", root)
    assert installs(steps) == [".[test]"]


@pytest.mark.parametrize("change", ["constraints", "dependencies", "interpreter", "stamp", "python"])
def test_an_environment_that_does_not_fit_is_made_anew(run, root, steps, change):
    run.set_up("runtime", root)
    (root / ".venv" / "old").touch()
    stamp = root / ".venv" / run.STAMP
    if change == "constraints":
        (root / "constraints.txt").write_text("numpy==1.0\n")
    elif change == "dependencies":
        project = (root / "pyproject.toml").read_text()
        (root / "pyproject.toml").write_text(project.replace('"typer>=0.12"', '"typer>=0.13"'))
    elif change == "interpreter":
        stamp.write_text(json.dumps({**json.loads(stamp.read_text()), "interpreter": "/no/python"}))
    elif change == "stamp":
        stamp.write_text(stamp.read_text()[:20])
    else:
        run.python_of(root / ".venv").unlink()
    run.set_up("runtime", root)
    assert installs(steps) == [".", "."]
    assert not (root / ".venv" / "old").exists()
    assert [entry.name for entry in root.glob(".venv-*")] == []


def test_settings_of_tools_do_not_make_it_anew(run, root, steps):
    run.set_up("runtime", root)
    project = (root / "pyproject.toml").read_text()
    (root / "pyproject.toml").write_text(project.replace("line-length = 110", "line-length = 111"))
    run.set_up("runtime", root)
    assert installs(steps) == ["."]


@pytest.mark.parametrize("failing", ["venv", "pip"])
def test_a_set_up_that_failed_is_not_trusted(run, root, steps, monkeypatch, failing):
    step = run.run_step

    def fail(command, root, lock):
        if failing in [str(word) for word in command]:
            raise run.SetUpError("no network")
        step(command, root, lock)

    with monkeypatch.context() as patch:
        patch.setattr(run, "run_step", fail)
        with pytest.raises(run.SetUpError, match="no network"):
            run.set_up("runtime", root)
    assert run.stamped_kinds(root / ".venv", run.fingerprint(root)) == set()
    (root / ".venv" / "half").touch()
    run.set_up("runtime", root)
    assert not (root / ".venv" / "half").exists()


def test_adding_the_tests_that_failed_is_not_trusted(run, root, steps, monkeypatch):
    run.set_up("runtime", root)

    def fail(command, root, lock):
        raise run.SetUpError("no network")

    with monkeypatch.context() as patch:
        patch.setattr(run, "run_step", fail)
        with pytest.raises(run.SetUpError):
            run.set_up("test", root)
    run.set_up("runtime", root)
    assert installs(steps) == [".", "."]


def test_an_environment_of_somebody_else_is_left_alone(run, root, steps):
    (root / ".venv" / "bin").mkdir(parents=True)
    (root / ".venv" / "pyvenv.cfg").write_text("home = /usr/bin")
    with pytest.raises(run.SetUpError, match=r"not made by run\.py"):
        run.set_up("runtime", root)
    assert (root / ".venv" / "pyvenv.cfg").read_text() == "home = /usr/bin"


def test_what_an_interrupted_removal_left_is_cleared(run, root, steps):
    (root / ".venv-discarded-1234" / "lib").mkdir(parents=True)
    run.set_up("runtime", root)
    assert not list(root.glob(".venv-discarded-*"))


@pytest.mark.skipif(os.name == "nt", reason="kills as POSIX does")
@pytest.mark.parametrize("moment", ["venv", "pip"])
def test_a_killed_set_up_is_not_trusted_and_its_pip_is_waited_for(run, root, steps, moment, capfd):
    """The child that a killed set-up leaves behind must not write into the next .venv."""
    script = textwrap.dedent(f"""
        import subprocess, sys
        sys.path.insert(0, {str(REPOSITORY)!r})
        import run
        from pathlib import Path
        run.provide_system_libraries = lambda kind, install: None
        real = run.run_step
        def step(command, root, lock):
            if {moment!r} in map(str, command):
                child = ("import pathlib, time; print('begun', flush=True); time.sleep(1.5);"
                         "pathlib.Path('.venv/late').touch()")
                subprocess.run([sys.executable, "-c", child], cwd=root, pass_fds=(lock,))
        run.run_step = step
        run.set_up("runtime", Path({str(root)!r}))
    """)
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert (root / ".venv").exists()
    run.set_up("runtime", root)
    assert installs(steps) == ["."]
    assert not (root / ".venv" / "late").exists()
    assert "waiting" in capfd.readouterr().err
    assert run.stamped_kinds(root / ".venv", run.fingerprint(root)) == {"runtime"}


def test_starts_at_the_same_time_set_up_once(run, root, steps, monkeypatch):
    step = run.run_step

    def slow(command, root, lock):
        time.sleep(0.2)
        step(command, root, lock)

    monkeypatch.setattr(run, "run_step", slow)
    starts = [threading.Thread(target=run.set_up, args=("runtime", root)) for _ in range(3)]
    for start in starts:
        start.start()
    for start in starts:
        start.join()
    assert installs(steps) == ["."]


def test_variables_of_the_machine_do_not_lead_pip_astray(run, root, monkeypatch):
    monkeypatch.setenv("PIP_TARGET", "/elsewhere")
    monkeypatch.setenv("PYTHONPATH", "/elsewhere")
    seen = root / "seen"
    code = f"import os, json; json.dump(dict(os.environ), open({str(seen)!r}, 'w'))"
    with run.only_one(root) as lock:
        run.run_step([sys.executable, "-c", code], root, lock)
    environment = json.loads(seen.read_text())
    assert not {"PIP_TARGET", "PYTHONPATH"} & set(environment)
    assert environment["PIP_CONSTRAINT"] == str(root / "constraints.txt")


def test_a_failing_step_names_its_command(run, root):
    with run.only_one(root) as lock, pytest.raises(run.SetUpError, match=r"step failed.*exit\(3\)"):
        run.run_step([sys.executable, "-c", "exit(3)"], root, lock)


# ------------------------------------------------------------------ system libraries


def only(*names):
    return lambda name: name in names


def test_missing_libraries_are_found_by_loading_them(run):
    assert run.is_present("libc.so.6") or not sys.platform.startswith("linux")
    assert not run.is_present("libno-such-thing.so.9")
    assert not run.is_present("no-such-program-anywhere")
    assert run.is_present("ensurepip") == (importlib.util.find_spec("ensurepip") is not None)


def test_what_is_missing_is_reported_by_package(run):
    present = only("libEGL.so.1", "libGL.so.1", "libglib-2.0.so.0", "libdbus-1.so.3", "ensurepip")
    missing = run.missing_needs(run.PROGRAM_NEEDS, present)
    assert [need.package for need in missing] == [
        "libosmesa6",
        "libopengl0",
        "libfontconfig1",
        "libxkbcommon0",
    ]


def test_egl_does_where_osmesa_is_gone(run):
    osmesa = next(need for need in run.PROGRAM_NEEDS if need.package == "libosmesa6")
    assert not run.is_needed(osmesa, only("libEGL.so.1"))
    assert run.is_needed(osmesa, only())


def test_test_engines_are_never_demanded(run):
    assert {need.name for need in run.TEST_NEEDS} >= {"xvfb-run", "liggghts", "lmp"}
    assert not any(run.is_needed(need, only()) for need in run.TEST_NEEDS)


def tell(run, monkeypatch, tools, missing):
    monkeypatch.setattr(run.shutil, "which", lambda name: f"/usr/bin/{name}" if name in tools else None)
    return run.advice([need for need in (*run.PROGRAM_NEEDS, *run.TEST_NEEDS) if need.name in missing])


def test_the_advice_is_one_command(run, monkeypatch):
    advice = tell(run, monkeypatch, {"apt-get"}, {"libGL.so.1", "xvfb-run"})
    assert advice == ("sudo apt-get update && sudo apt-get install -y --no-install-recommends libgl1 xvfb")
    assert tell(run, monkeypatch, {"dnf"}, {"libGL.so.1"}) == "sudo dnf install 'libGL.so.1()(64bit)'"
    assert tell(run, monkeypatch, set(), {"libGL.so.1"}).endswith("package manager: libGL.so.1")


@pytest.fixture
def system(run, monkeypatch):
    """A Debian-like system that lacks libGL and liggghts; apt-get brings only libGL."""
    lacking = {"libGL.so.1", "liggghts"}
    commands = []
    monkeypatch.setattr(run, "is_present", lambda name: name not in lacking)
    monkeypatch.setattr(
        run,
        "missing_needs",
        lambda needs: [need for need in needs if need.name in lacking],
    )
    monkeypatch.setattr(run.shutil, "which", lambda name: "/usr/bin/apt-get" if name == "apt-get" else None)
    monkeypatch.setattr(run.os, "geteuid", lambda: 0, raising=False)

    def fake_run(command, **_options):
        commands.append(command)
        if "--simulate" in command:
            return subprocess.CompletedProcess(command, 100 if "liggghts" in command else 0)
        if "install" in command:
            lacking.difference_update({"libGL.so.1"} if "libgl1" in command else set())
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(run.subprocess, "run", fake_run)
    return commands


def test_root_on_debian_installs_what_is_missing(run, system, capsys):
    run.provide_system_libraries("test", install=True)
    assert system[0][:2] == ["apt-get", "update"]
    install = next(words for words in system if "install" in words and "--simulate" not in words)
    assert "libgl1" in install
    assert "--no-install-recommends" in install
    assert "liggghts" not in install
    assert "liggghts is not to be had in this distribution" in capsys.readouterr().err


def test_others_are_told_the_command(run, system, monkeypatch):
    monkeypatch.setattr(run.os, "geteuid", lambda: 1000, raising=False)
    with pytest.raises(run.SetUpError, match=r"sudo apt-get install -y --no-install-recommends libgl1"):
        run.provide_system_libraries("runtime", install=True)
    assert system == []


def test_a_set_up_that_cannot_go_on_exits_with_an_error(run, monkeypatch, capsys):
    def fail(kind):
        raise run.SetUpError("the system lacks libGL.so.1")

    monkeypatch.setattr(run, "set_up", fail)
    assert run.main(["fit"]) == 1
    assert "lacks libGL.so.1" in capsys.readouterr().err


# ------------------------------------------------------------------ what is started


def test_arguments_go_to_the_program(run, monkeypatch):
    python = Path("python")
    assert run.command_of(["fit", "a.tif"], python) == ["python", "-m", "mbstudio", "fit", "a.tif"]
    assert run.command_of(["test", "-k", "scan"], python) == ["python", "-m", "pytest", "-k", "scan"]
    everything = run.command_of(["test"], python)
    assert everything[:3] == ["python", "-m", "pytest"]
    assert "-n" in everything
    monkeypatch.setattr(run, "has_display", lambda: True)
    assert run.command_of([], python)[2:] == ["mbstudio", "gui", "--sample"]
    monkeypatch.setattr(run, "has_display", lambda: False)
    assert run.command_of([], python)[2:] == ["mbstudio", "tour", "--out", "tour/"]


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        (["--cov"], ["--cov=mbstudio", "-n", "2", "--dist", "loadfile"]),
        (
            ["--cov", "--cov-report=html"],
            ["--cov=mbstudio", "--cov-report=html", "-n", "2", "--dist", "loadfile"],
        ),
        (["--cov", "tests/core"], ["--cov=mbstudio", "tests/core"]),
        (["-x"], ["-x"]),
    ],
)
def test_coverage_is_that_of_the_package_on_two_cores_too(run, asked, given):
    assert run.command_of(["test", *asked], Path("python")) == ["python", "-m", "pytest", *given]


@pytest.fixture
def checks(run, monkeypatch):
    """Stands in for the checks: what was set up and run, and the tool that fails, if any."""
    kinds, commands, failing = [], [], set()

    def fake_run(command, **_options):
        commands.append(command)
        return subprocess.CompletedProcess(command, int(command[2] in failing))

    def fake_set_up(kind):
        kinds.append(kind)
        return Path("python")

    monkeypatch.setattr(run, "set_up", fake_set_up)
    monkeypatch.setattr(run.subprocess, "run", fake_run)
    return kinds, commands, failing


def test_check_runs_the_linters_of_the_test_tools(run, checks):
    kinds, commands, _ = checks
    assert run.main(["check"]) == 0
    assert kinds == ["test"]
    assert [command[1:] for command in commands] == [
        ["-m", "ruff", "check"],
        ["-m", "ruff", "format", "--check"],
        ["-m", "mypy"],
    ]


def test_one_check_that_fails_does_not_hide_the_next(run, checks, capsys):
    _, commands, failing = checks
    failing.add("ruff")
    assert run.main(["check"]) == 1
    assert commands[-1][-1] == "mypy"
    assert "failed: ruff check, ruff format --check" in capsys.readouterr().err


def test_every_way_to_the_checks_runs_the_same_ones(run):
    integration = (REPOSITORY / ".ci" / "run").read_text().splitlines()
    assert integration[-2:] == ["python3 run.py check", "exec python3 run.py test"]
    hooks = (REPOSITORY / ".pre-commit-config.yaml").read_text()
    assert re.findall(r"entry: (.+)", hooks) == [" ".join(words) for words in run.CHECKS]
    workflow = (REPOSITORY / ".github" / "workflows" / "tests.yml").read_text()
    commands = re.findall(r"- run: (python run\.py .+)", workflow)
    assert commands == ["python run.py check", "python run.py test"]


def test_the_workflow_tries_the_pythons_that_are_supported():
    workflow = (REPOSITORY / ".github" / "workflows" / "tests.yml").read_text()
    oldest = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["requires-python"]
    pythons = re.findall(r'"(3\.\d+)"', workflow)
    assert oldest == f">={pythons[0]}"
    assert pythons == ["3.11", "3.12", "3.13"]


def test_engines_of_the_set_up_are_those_it_brings(run, monkeypatch):
    monkeypatch.delenv(run.OTHER_PYTHON, raising=False)
    monkeypatch.setattr(run.sys, "platform", "linux")
    monkeypatch.setattr(run.platform, "machine", lambda: "x86_64")
    assert run.engines_of_set_up(lambda program: True) == ["LIGGGHTS", "LAMMPS", "Kratos", "peclet-dem"]
    assert run.engines_of_set_up(lambda program: program == "lmp") == ["LAMMPS", "Kratos", "peclet-dem"]
    monkeypatch.setenv(run.OTHER_PYTHON, "/other/python")
    assert run.engines_of_set_up(lambda program: False) == []
    monkeypatch.delenv(run.OTHER_PYTHON)
    monkeypatch.setattr(run.platform, "machine", lambda: "aarch64")
    assert run.engines_of_set_up(lambda program: False) == []


def test_the_extra_brings_the_engines_that_are_expected(run):
    from packaging.requirements import Requirement

    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    extra = map(Requirement, project["project"]["optional-dependencies"]["test"])
    wanted = {found.name.lower(): found.marker for found in extra}
    place = {"sys_platform": "linux", "platform_machine": "x86_64"}
    packages = {"Kratos": ("kratosdemapplication", "kratosmultiphysics"), "peclet-dem": ("peclet-dem",)}
    assert set(packages) == set(run.ENGINE_PACKAGES)
    for engine, (major, last) in run.ENGINE_PACKAGES.items():
        for name in packages[engine]:
            for minor, there in ((11, True), (last, True), (last + 1, False)):
                version = f"{major}.{minor}"
                assert wanted[name].evaluate({**place, "python_version": version}) is there
            assert not wanted[name].evaluate(
                {**place, "platform_machine": "aarch64", "python_version": "3.12"}
            )


def test_every_dependency_is_pinned():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    pinned = {
        line.split("==")[0].lower().replace("_", "-")
        for line in (REPOSITORY / "constraints.txt").read_text().splitlines()
        if line and not line.startswith("#")
    }
    wanted = [
        *project["project"]["dependencies"],
        *project["project"]["optional-dependencies"]["test"],
        *project["build-system"]["requires"],
    ]
    names = {word.split(";")[0].split(">")[0].strip().lower().replace("_", "-") for word in wanted}
    assert names <= pinned
    assert "+" not in (REPOSITORY / "constraints.txt").read_text()


def test_run_needs_nothing_but_python():
    tree = ast.parse((REPOSITORY / "run.py").read_text())
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} <= sys.stdlib_module_names
