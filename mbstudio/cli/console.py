"""What the commands print: results on stdout, everything else on stderr."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from mbstudio.core.options import Option

SECONDS_BETWEEN_LINES = 2.0


def tell(message: str) -> None:
    """Print a message beside the results, as one line without markup."""
    print(message, file=sys.stderr, flush=True)


@contextmanager
def progress(title: str) -> Iterator[Callable[[float, str], None]]:
    """Show how far a long piece of work has come; yields ``report(fraction, message)``.

    On a terminal that is a bar; in a log, a line every ten percent and not too often.
    """
    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield _lines(title)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda fraction, message: bar.update(
            task, completed=fraction, description=f"{title}: {message}"
        )


def _lines(title: str) -> Callable[[float, str], None]:
    reached, said = -1, -math.inf

    def report(fraction: float, message: str) -> None:
        nonlocal reached, said
        tenth, now = int(10 * fraction + 1e-9), time.monotonic()
        if tenth > reached and now - said > SECONDS_BETWEEN_LINES:
            reached, said = tenth, now
            tell(f"{title}: {100 * fraction:3.0f} % {message}")

    return report


def print_json(result: Any) -> None:
    """Print a result as JSON on stdout; what is not a finite number becomes null."""
    print(json.dumps(plain(result), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Return a value as JSON knows it."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy's arrays and scalars
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print rows below their headings on stdout."""
    table = Table(title=title, title_justify="left", show_edge=False)
    for index, name in enumerate(columns):
        table.add_column(name, justify="left" if index == 0 else "right")
    for row in rows:
        table.add_row(*(text(cell) for cell in row))
    # In a file there is no edge of a screen at which to break lines.
    Console(file=sys.stdout, width=None if sys.stdout.isatty() else 200, highlight=False).print(table)


def print_options(options: Mapping[str, Option]) -> None:
    """Print options with their defaults and what they mean, one a line, on stdout."""
    for name, option in options.items():
        print(f"    {name}={option.default}  {option.meaning}")


def print_facts(title: str, facts: Mapping[str, Any]) -> None:
    """Print names and values, one a line, on stdout."""
    table = Table.grid(padding=(0, 2))
    for name, value in facts.items():
        table.add_row(f"  {name.replace('_', ' ')}", text(value))
    print(title)
    Console(file=sys.stdout, width=None if sys.stdout.isatty() else 200, highlight=False).print(table)


def text(value: Any) -> str:
    """Return a cell as people read it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "–"
    return "–" if value is None else str(value)
