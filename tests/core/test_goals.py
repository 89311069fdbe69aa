"""Goals: one grammar for what fits and clumps are to reach."""

from __future__ import annotations

import pytest

from mbstudio.core.dem import ClumpGoal
from mbstudio.core.errors import ExportError, FitError, MbstudioError
from mbstudio.core.goals import Goal, SmallestNumber, spell_measure, split_sentence
from mbstudio.core.imaging import FitGoal
from mbstudio.core.vae.generate.conditions import parse_conditions

KINDS: dict[type[Goal], type[MbstudioError]] = {FitGoal: FitError, ClumpGoal: ExportError}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("iou 0.95", "iou 0.95"),
        ("IoU >= 95 %; Volume 1 %", "iou 0.95 and volume 1 %"),
        ("hausdorff=.03,volume < 1e-2 and n 200", "hausdorff 3 % and volume 1 % and n 200"),
        ("volume 2 % and n 320", "volume 2 %"),
    ],
)
def test_both_kinds_read_the_same_sentences(kind: type[Goal], text: str, written: str) -> None:
    goal = kind.parse(text)
    assert type(goal) is kind
    assert str(goal) == written
    assert kind.parse(written) == goal
    assert kind.parse(goal) is goal


@pytest.mark.parametrize(("kind", "error"), KINDS.items())
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "beauty 1 %",
            "'beauty 1 %' is not a goal for .*it names 'beauty', which is not known: use .*, or n",
        ),
        ("volume", "write a measure and its limit, as in '.*'. Known: .*hausdorff"),
        ("volume 3", "'volume 3' is impossible: an error lies between 0 and 100 %: write it as 'volume 1 %'"),
        ("iou 0", "'iou 0' is impossible: an iou lies between 0 and 1"),
        ("iou .9, iou .8", "names iou twice"),
        ("n 9", "contains no measure"),
        ("iou .9 and n 0", "'n 0' is not a number of (control points|spheres): write a whole number"),
    ],
)
def test_both_kinds_refuse_alike(
    kind: type[Goal], error: type[MbstudioError], text: str, message: str
) -> None:
    with pytest.raises(error, match=message):
        kind.parse(text)


def test_values_are_described_and_judged() -> None:
    goal = FitGoal.parse("volume 1 % and iou 0.9")
    values = {"volume": -0.02, "iou": 0.95}
    assert goal.describe(values) == "volume 2 %, iou 0.9500"
    assert goal.describe(values, only_missed=True) == "volume 2 %"
    assert not goal.is_met(values)
    assert goal.shortfall(values) == pytest.approx(2.0)
    assert goal.describe({"volume": float("nan"), "iou": 1.0}) == "volume unknown, iou 1.0000"


def test_factors_have_one_spelling() -> None:
    assert [spell_measure(name) for name in ("Sneed-Folk", " D_n ", "corey", "CSF", "sneed  folk")] == [
        "sneed_folk", "dn", "csf", "csf", "sneed_folk",
    ]  # fmt: skip
    assert split_sentence("a 1 and b 2; sand 3") == ["a 1", "b 2", "sand 3"]
    same = parse_conditions(["Corey=0.7; D_n=1..2 and D50=1"], "mm")
    assert same == parse_conditions(["csf=0.7", "dn=1..2", "D50=1"], "mm")


def test_numbers_begin_at_the_fewest() -> None:
    numbers, tried = SmallestNumber(40, fewest=4), []
    while (n := numbers.choose_next()) is not None:
        tried.append(n)
        numbers.record(n, will_do=True)
    assert tried == [10, 6, 4]
    assert numbers.enough == 4
