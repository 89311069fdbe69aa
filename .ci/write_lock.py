"""Writes the lock of the tested set: constraints.txt with the SHA-256 of each package's wheel.

    python -m pip install --dry-run --ignore-installed --no-deps --only-binary :all: \
        -r constraints.txt --report report.json
    python .ci/write_lock.py report.json

The hashes are those of one system and Python, which the name of the lock says. ``tests/test_lock.py`` checks
that it agrees with constraints.txt.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]


def lock_of(report: dict[str, Any]) -> tuple[str, str]:
    """Return name and text of the lock that a report of pip stands for."""
    told = report["environment"]
    system = f"{told['sys_platform']}-{told['platform_machine']}-py{told['python_version'].replace('.', '')}"
    lines = [
        f"# The wheels that mbstudio was tested with on {system}. Install them, and nothing else, by",
        f"# python -m pip install --require-hashes --no-deps -r requirements-{system}.lock",
        "# torch is its build for processors. Made by .ci/write_lock.py.",
    ]
    for entry in sorted(report["install"], key=lambda one: one["metadata"]["name"].lower()):
        version = entry["metadata"]["version"].partition("+")[0]
        digest = entry["download_info"]["archive_info"]["hashes"]["sha256"]
        lines.append(f"{entry['metadata']['name']}=={version} --hash=sha256:{digest}")
    return f"requirements-{system}.lock", "\n".join(lines) + "\n"


if __name__ == "__main__":
    name, text = lock_of(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    (REPOSITORY / name).write_text(text, encoding="utf-8")
