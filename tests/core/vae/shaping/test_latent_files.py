"""Recipes and tables of latent vectors from outside: each fault is one line that names file and place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.shaping.latent_files import read_latents, read_recipes
from mbstudio.core.vae.shaping.latent_recipe import Operation, Recipe

TABLE = 'name,csf,recipe,z1,z2\r\nmoved_1,0.6,"a morph, long",0.5,-1e-3\r\nmoved_2,0.7,x,1,2\r\n'


def test_latents_are_read_by_name(tmp_path: Path) -> None:
    path = tmp_path / "latents.csv"
    path.write_text(TABLE, encoding="utf-8", newline="")
    found = read_latents(path)
    assert list(found) == ["moved_1", "moved_2"]
    np.testing.assert_array_equal(found["moved_1"], [0.5, -1e-3])
    path.write_text(TABLE.replace("z1,z2", "z2,z1"), encoding="utf-8", newline="")
    np.testing.assert_array_equal(read_latents(path)["moved_1"], [-1e-3, 0.5])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (TABLE.replace("0.5", "inf"), "'inf' in line 2 under z1, which is no finite number"),
        (TABLE.replace("0.5", "nan"), "'nan' in line 2"),
        (TABLE.replace("0.5", "abc"), "'abc' in line 2"),
        (TABLE.replace("0.5", "9" * 400), "no finite number"),
        (TABLE.replace("name", "nom"), "no single column 'name'"),
        (TABLE.replace("z1,z2", "z1,z3"), "lacks the column 'z2'"),
        (TABLE.replace("z1,z2", "z1,z1"), "has one twice"),
        (TABLE.replace("z1,z2", "a,b"), "lacks the column 'z1'"),
        (TABLE.replace("moved_2", "moved_1"), "names two grains 'moved_1'"),
        (TABLE.replace("-1e-3", "-1e-3,7"), "6 cells in line 2 under 5 headings"),
        ('name,z1\r\n"x,1\r\n', "cannot be read as a table"),
        ("", "no single column 'name'"),
    ],
)
def test_tables_that_are_damaged(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "latents.csv"
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(StyleError, match=told) as caught:
        read_latents(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_recipes_are_read_and_damaged_ones_refused(tmp_path: Path) -> None:
    path = tmp_path / "recipes.json"
    recipe = Recipe("one", (0.1, 2.0), (Operation("average", {}, "the mean"),), "abc")
    record = recipe.as_record()
    path.write_text(json.dumps([record]), encoding="utf-8")
    assert read_recipes(path) == [recipe]
    for damaged in (
        {**record, "z": [0.1, "abc"]}, {**record, "z": []}, {**record, "z": [True]},
        {**record, "z": [10**400]},
        {**record, "z": {"a": 1}}, {**record, "name": 7}, {**record, "operations": [1]},
        {**record, "operations": [{"kind": "x"}]}, {k: v for k, v in record.items() if k != "z"},
        [], "abc", None,
    ):  # fmt: skip
        path.write_text(json.dumps([damaged]), encoding="utf-8")
        with pytest.raises(StyleError, match=r"recipes\.json is damaged: ") as caught:
            read_recipes(path)
        assert "\n" not in str(caught.value)
    for text, told in (
        ("{}", "no list of recipes"),
        ("[", "cannot be read as recipes"),
        ("[NaN]", "number NaN"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(StyleError, match=told):
            read_recipes(path)
