from __future__ import annotations

from pathlib import Path

import pytest

from mbstudio.core.memory import free_memory, left_in_control_groups, readable_bytes


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 bytes"),
        (999, "999 bytes"),
        (1000, "1.00 kB"),
        (448e6, "448 MB"),
        (999_600, "1.00 MB"),
        (14.2e9, "14.2 GB"),
        (9.996e9, "10.0 GB"),
        (1.5e12, "1500 GB"),
    ],
)
def test_bytes_are_read_at_a_glance(count: float, words: str) -> None:
    assert readable_bytes(count) == words


@pytest.mark.parametrize(
    ("count", "words"),
    [(14.4e9, "14 GB"), (9.04e9, "9.0 GB"), (9.96e9, "10 GB"), (448e6, "448 MB"), (87.3e6, "87 MB")],
)
def test_estimates_have_two_digits(count: float, words: str) -> None:
    assert readable_bytes(count, 2) == words


def group(folder: Path, limit: str, used: int, files: int, version: int = 2) -> None:
    """Write what Linux shows of a control group."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ("max", "current") if version == 2 else ("limit_in_bytes", "usage_in_bytes")
    for name, value in zip(names, (limit, used), strict=True):
        (folder / f"memory.{name}").write_text(f"{value}\n")
    key = "inactive_file" if version == 2 else "total_inactive_file"
    (folder / "memory.stat").write_text(f"anon 5\n{key} {files}\n")


def test_a_container_has_no_more_than_its_limit(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("0::/slurm/job_7\n")
    assert left_in_control_groups(tmp_path / "none", own) is None
    group(tmp_path / "slurm" / "job_7", "max", 900, 0)
    assert left_in_control_groups(tmp_path, own) is None
    group(tmp_path / "slurm", "5000", 3000, 400)
    assert left_in_control_groups(tmp_path, own) == 2400
    group(tmp_path / "slurm" / "job_7", "1000", 900, 50)
    assert left_in_control_groups(tmp_path, own) == 150
    group(tmp_path / "slurm" / "job_7", "1000", 1100, 0)
    assert left_in_control_groups(tmp_path, own) == 0


def test_a_container_of_the_first_kind(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("3:cpu,cpuacct:/x\n4:memory:/docker/abc\n0::/\n")
    # Within the container only its own group is seen, as the root.
    group(tmp_path / "memory", "1000", 900, 50, version=1)
    assert left_in_control_groups(tmp_path, own) == 150


def test_this_machine_has_some_memory_left() -> None:
    left = free_memory()
    assert left is None or 10**6 < left < 10**15
    assert left_in_control_groups(own=Path("/nowhere")) is None
