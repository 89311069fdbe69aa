"""Options of a method from text, back to what changed, and what is said of them."""

from __future__ import annotations

import inspect
from dataclasses import fields

import pytest

from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import fit, start_fit
from mbstudio.core.imaging.fast.fast import FastOptions
from mbstudio.core.imaging.options import find_options, make_options, read_options
from mbstudio.core.imaging.paper.gradient_search import PaperOptions


def test_each_kind_of_option_is_read() -> None:
    texts = ["generations=300", "learning_rate=2e-3", "common_factor=no", "parameter = k", "unit=voxel"]
    expected = {
        "generations": 300, "learning_rate": 0.002, "common_factor": False, "parameter": "k", "unit": "voxel",
    }  # fmt: skip
    assert read_options("paper", texts) == expected
    assert read_options("fast", ["working_side=80"]) == {"working_side": 80}


def test_defaults_are_left_out_and_the_last_word_counts() -> None:
    assert read_options("paper", ["generations=1500", "momentum=0"]) == {}
    assert read_options("paper", ["generations=7", "generations=9"]) == {"generations": 9}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("generations", "name=value"),
        ("speed=3", "no option 'speed'.*generations.*clustering"),
        ("refine=3", "no option 'refine'"),
        ("generations=many", "whole number"),
        ("generations=2.5", "whole number"),
        ("learning_rate=fast", "a number"),
        ("learning_rate=nan", "not finite"),
        ("common_factor=perhaps", "common_factor=yes or common_factor=no"),
        ("weight=cube", "weight=square, weight=radius"),
        ("beta1=1.5", "beta1 = 1.5"),
    ],
)
def test_what_cannot_be_read_is_named(text: str, message: str) -> None:
    with pytest.raises(FitError, match=message):
        read_options("paper", [text])


@pytest.mark.parametrize("name", ["generations", "working_side", "hull_points"])
def test_the_fast_method_refuses_empty_options(name: str) -> None:
    with pytest.raises(FitError, match=f"{name} = 0"):
        make_options("fast", {name: 0})


def test_an_unknown_method_is_named() -> None:
    with pytest.raises(FitError, match="'slow'"):
        read_options("slow", [])  # type: ignore[arg-type]
    assert (find_options("fast"), find_options("paper")) == (FastOptions, PaperOptions)


def test_every_option_of_the_paper_can_be_given_as_text_and_is_documented() -> None:
    names = [field.name for field in fields(PaperOptions)]
    known = find_options("paper").list_options().options
    assert list(known) == names
    notes = {name: option.meaning for name, option in known.items()}
    documented = inspect.getdoc(PaperOptions) or ""
    for name, note in notes.items():
        assert len(note) > 5, name
        assert " ".join(note.split()[:3]) in " ".join(documented.split())
    assert notes["beta1"] == notes["beta2"]
    assert notes["generations"] == "E_gs. The paper gives no number."


def test_a_result_tells_the_options_it_was_made_with(ellipsoid_grain: Grain) -> None:
    assert PaperOptions(momentum=0.5, hull="surface").list_changed() == {"momentum": 0.5}
    given = {"generations": 3, "hull_points": 500, "clustering": "letter"}
    result = fit(ellipsoid_grain, 3, "paper", **given)
    assert result.options == {"generations": 3, "hull_points": 500}  # 'letter' is the default
    again = fit(ellipsoid_grain, 3, result.method, result.seed, **result.options)
    assert (again.avatar.weights == result.avatar.weights).all()
    run = start_fit(ellipsoid_grain, 3)
    for step in run:
        if step.phase == "search":
            break
    assert run.result().options == {}
