"""Options: read from text, checked, told; and their words without docstrings."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from mbstudio.core.errors import ExportError, StyleError
from mbstudio.core.options import Option, OptionList, OptionRecord, option

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Settings(OptionRecord, owner="method 'sieving'", error=StyleError):
    """Options of a method."""

    shakes: int = option(7, "How often the sieve is shaken.", minimum=1, maximum=9)
    share: float = option(0.5, "What may be lost.", minimum=0, below=1)
    mesh: str = option("fine", "How wide it is.", choices=("fine", "coarse"))
    wet: bool = option(False, "Whether there is water.")
    note: str = option("", "What to remember.")
    constants: tuple[int, ...] = field(default=(1, 2))


def known() -> OptionList:
    return Settings.list_options()


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (Option(1, ""), "a whole number"),
        (Option(1, "", 8, 200), "a whole number from 8 to 200"),
        (Option(1, "", minimum=1), "a whole number, 1 or more"),
        (Option(1.0, "", above=0), "a number above 0"),
        (Option(1.0, "", maximum=3), "a number to 3"),
        (Option(0.5, "", minimum=0, below=1), "a number from 0 to below 1"),
        (Option(0.5, "", below=1), "a number below 1"),
        (Option(True, ""), "yes or no"),
        (Option("", ""), "text"),
        (Option("a", "", choices=("a", "b")), "one of 'a', 'b'"),
    ],
)
def test_what_is_allowed_is_said_in_words(option: Option, words: str) -> None:
    assert option.allowed == words


@pytest.mark.parametrize(
    ("default", "given", "value"),
    [
        (1, "12", 12), (1, " -3 ", -3), (1, "1e2", 100), (1, 4.0, 4), (1, 4.5, None), (1, "4.5", None),
        (1, "9007199254740993", 9007199254740993), (1, float("inf"), None), (1, "many", None), (1, [], None),
        (1.0, "2e-3", 0.002), (1.0, 3, 3.0), (1.0, "nan", None), (1.0, object(), None),
        (True, "No", False), (False, "on", True), (False, True, True), (False, 0, False), (False, "2", None),
        ("", 5, "5"), ("", "words", "words"),
    ],
)  # fmt: skip
def test_values_and_texts_become_the_type_of_the_option(
    default: object, given: object, value: object
) -> None:
    converted = Option(default, "").convert(given)
    assert converted == value
    assert type(converted) is (type(None) if value is None else type(default))


def test_a_record_lists_its_options_and_what_was_changed() -> None:
    assert list(known().options) == ["shakes", "share", "mesh", "wet", "note"]
    assert known().options["shakes"].meaning == "How often the sieve is shaken."
    assert Settings().list_changed() == {}
    changed = Settings.make({"wet": True, "shakes": 7, "constants": (3,)})
    assert changed.list_changed() == {"wet": True, "constants": (3,)}
    assert Settings.read(["wet=yes", "mesh = coarse", "wet=no"]) == Settings(mesh="coarse")
    assert pickle.loads(pickle.dumps(changed)) == changed
    assert "shakes : int\n        How often the sieve is shaken." in (Settings.__doc__ or "")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shakes": 0}, "shakes = 0 is not possible for method 'sieving': give a whole number from 1 to 9"),
        ({"shakes": 10}, "shakes = 10"),
        ({"share": 1.0}, "share = 1.0.*from 0 to below 1"),
        ({"share": float("nan")}, "share = nan"),
        ({"share": "half"}, "share = 'half'"),
        ({"mesh": "wide"}, "mesh = 'wide'.*one of 'fine', 'coarse'"),
        ({"speed": 1}, "Method 'sieving' has no option 'speed': it has shakes, .*note, constants"),
    ],
)
def test_a_record_refuses_what_does_not_suit(given: dict[str, object], message: str) -> None:
    with pytest.raises(StyleError, match=message):
        Settings.make(given)


def test_a_copy_of_a_record_is_checked_too() -> None:
    with pytest.raises(StyleError, match="shakes = 0"):
        replace(Settings(), shakes=0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shakes", "has no value: write it as name=value"),
        ("constants=3", "no option 'constants'"),
        ("shakes=often", "'shakes=often' cannot be read: give a whole number, for example shakes=3"),
        ("share=-inf", "'share=-inf' is not finite: give a number"),
        ("share=1e999", "not finite"),
        ("wet=perhaps", "is not valid: write wet=yes or wet=no"),
        ("mesh=wide", "is not a valid choice: write mesh=fine, mesh=coarse"),
        ("shakes=12", "shakes = 12"),
    ],
)
def test_a_text_that_cannot_be_read_is_named(text: str, message: str) -> None:
    with pytest.raises(StyleError, match=message):
        Settings.read([text])


def test_a_list_completes_what_is_given() -> None:
    listed = OptionList("target 'stl'", ExportError, known().options)
    assert listed.complete({"shakes": "3", "wet": None}) == {
        "shakes": 3, "share": 0.5, "mesh": "fine", "wet": False, "note": "",
    }  # fmt: skip
    with pytest.raises(ExportError, match="Option 'wet' of target 'stl' cannot be 3: give yes or no"):
        listed.complete({"wet": 3})
    with pytest.raises(ExportError, match="Target 'stl' has no option 'x': it has none"):
        OptionList("target 'stl'", ExportError, {}).complete({"x": 1})


_TELL_ALL = """
import json, sys
from mbstudio.core.dem.target import targets
from mbstudio.core.imaging.options import find_options
from mbstudio.core.vae.models.presets import PRESETS, find_preset
lists = [find_options(method).list_options().options for method in ("fast", "paper")]
lists += [find_preset(name).options.list_options().options for name in PRESETS]
lists += [target.options for target in targets().values()]
tips = [[[name, option.meaning, option.allowed] for name, option in known.items()] for known in lists]
import typer.testing
from mbstudio.cli.app import app
run = typer.testing.CliRunner()
helps = [run.invoke(app, [command.callback.__name__, "--help"]).output for command in app.registered_commands]
lists_of_options = (["--help"], ["fit", "--options"], ["export", "--targets"])
helps += [run.invoke(app, words).output for words in lists_of_options]
print(json.dumps([sys.flags.optimize, tips, helps]))
"""


def test_tool_tips_and_help_survive_without_docstrings() -> None:
    told = []
    for flags in ([], ["-OO"]):
        done = subprocess.run(
            [sys.executable, *flags, "-c", _TELL_ALL],
            capture_output=True, text=True, cwd=ROOT, check=True, timeout=240,
            env={**os.environ, "COLUMNS": "100", "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        told.append(json.loads(done.stdout.splitlines()[-1]))
    (level, tips, helps), (optimised, bare_tips, bare_helps) = told
    assert (level, optimised) == (0, 2)
    assert bare_tips == tips
    assert bare_helps == helps
    assert len(tips) > 15
    assert all(len(meaning) > 3 for known in tips for _, meaning, _ in known)
    assert all(len(text) > 100 for text in helps)
    assert "E_gs" in helps[-2]
    assert "Monte Carlo" in helps[-1]
