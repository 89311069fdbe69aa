"""The command ``mbstudio``: its commands, and what becomes of errors."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Annotated, Any

import typer

import mbstudio
from mbstudio.cli import (
    console,
    doctor,
    edit,
    export,
    figures,
    fit,
    generate,
    gui,
    judge,
    learn,
    measure,
    report,
    segment,
    sweep,
    tour,
    twin,
)
from mbstudio.cli.laboratory import enough, grading, porosity
from mbstudio.cli.packings import pack, packing
from mbstudio.cli.shaping import latent
from mbstudio.core.errors import MbstudioError

FAILED = 1
INTERRUPTED = 130

app = typer.Typer(
    name="mbstudio",
    help="From X-ray CT stacks of grains to metaball avatars for DEM simulations.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_COMMANDS: dict[ModuleType, Callable[..., None]] = {
    gui: gui.gui,
    tour: tour.tour,
    segment: segment.segment,
    edit: edit.edit,
    fit: fit.fit,
    twin: twin.twin,
    sweep: sweep.sweep,
    measure: measure.measure,
    report: report.report,
    enough: enough.enough,
    grading: grading.grading,
    porosity: porosity.porosity,
    export: export.export,
    pack: pack.pack,
    packing: packing.packing,
    learn: learn.learn,
    generate: generate.generate,
    judge: judge.judge,
    latent: latent.latent,
    figures: figures.figures,
    doctor: doctor.doctor,
}
for _module, _command in _COMMANDS.items():
    # Not from docstrings, which python -OO drops.
    app.command(help=_module.HELP, cls=getattr(_module, "OrderedCommand", None))(_command)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"mbstudio {mbstudio.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    context.obj = {"debug": debug}
    if not debug:
        warnings.showwarning = _show_warning


def _show_warning(message: Warning | str, category: type[Warning], *_place: Any, **_more: Any) -> None:
    """Show mbstudio's own warnings; those of its libraries are for developers."""
    if category.__module__.startswith("mbstudio"):
        console.tell(f"mbstudio: {message}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code.

    0 when all went well, 1 for an error with one message on stderr, 2 for a wrong call, 130
    when interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    try:
        app(words)
    except MbstudioError as error:
        _fail(str(error), debug)
    except BrokenPipeError:
        # Whoever read the output has seen enough; nothing more can be written, not even at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
    except OSError as error:
        named = f"{error.filename}: " if error.filename else ""
        _fail(f"{named}{error.strerror or error}", debug)
    except MemoryError:
        _fail("There is not enough memory on this machine: close other programs, or crop the scan.", debug)
    except KeyboardInterrupt:
        console.tell("mbstudio: interrupted.")
        sys.exit(INTERRUPTED)
    except Exception as error:
        _fail(
            f"This is a bug in mbstudio ({type(error).__name__}: {error}). "
            "Run 'mbstudio --debug ...' to see where it arose, and report it.",
            debug,
        )


def _fail(message: str, debug: bool) -> None:
    if debug:
        raise  # called while an exception is handled
    console.tell(f"mbstudio: {message}")
    sys.exit(FAILED)
