"""Where the files beside the code lie: recipes, icons, theme."""

from __future__ import annotations

from pathlib import Path

from mbstudio.core.errors import MbstudioError

_PACKAGE = Path(__file__).parent.parent


def assets_folder() -> Path:
    """Return the folder of assets: ``assets/`` of a checkout, ``mbstudio/_assets`` of a wheel."""
    for folder in (_PACKAGE / "_assets", _PACKAGE.parent / "assets"):
        if folder.is_dir():
            return folder
    raise MbstudioError(f"The assets of mbstudio are missing beside {_PACKAGE}: install it again.")


def asset(name: str) -> Path:
    """Return the path of one asset, for example ``asset("sample_scan.toml")``.

    Raises
    ------
    MbstudioError
        If the installation is incomplete.
    """
    path = assets_folder() / name
    if not path.is_file():
        raise MbstudioError(f"{path} is missing: the installation is incomplete, install mbstudio again.")
    return path


def document(name: str) -> Path:
    """Return the path of a document, for example ``document("user-guide.md")``.

    Documents lie in ``docs/`` of a checkout and in ``mbstudio/_docs`` of a wheel.

    Raises
    ------
    MbstudioError
        If the installation is incomplete.
    """
    for folder in (_PACKAGE / "_docs", _PACKAGE.parent / "docs"):
        if (folder / name).is_file():
            return folder / name
    raise MbstudioError(
        f"The document {name} is missing: the installation is incomplete, install mbstudio again."
    )
