"""Tables of laboratories: read as they are written, and refused where they do not add up."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError, UnitError
from mbstudio.core.populations import size_distribution
from mbstudio.core.populations.laboratory import largest_gap, parse_laboratory_table, read_laboratory_table
from tests.core.populations.made import spheres

SIZES, FINER = (0.25, 0.5, 1.0, 2.0), (10.0, 35.0, 80.0, 100.0)
TABLES = {
    "english, passing": "Sieve size (mm),Passing (%)\n2,100\n1,80\n0.5,35\n0.25,10\n",
    "german, passing": "Maschenweite [mm];Siebdurchgang [%]\n0,25;10\n0,5;35\n1;80\n2;100\n",
    "german, grams": (
        "Korngröße (mm);Siebrückstand (g)\n2,0;0\n1,0;40,0\n0,5;90,0\n0,25;50,0\nBoden;20,0\nSumme;200,0\n"
    ),
    "percent retained": "size (mm)\tretained (%)\n2\t0\n1\t20\n0.5\t45\n0.25\t25\npan\t10\n",
    "cumulative retained": "size (mm);cum. retained (%)\n0.25;90\n0.5;65\n1;20\n2;0\n",
    "microns": "Size (µm);Q3 (%)\n250;10\n500;35\n1000;80\n2000;100\n",
    "words before": "Camsizer;run 12\nmaterial;sand\nsize [mm];p3 [%];Q3 "
    "[%]\n0,25;10;10\n0,5;25;35\n1;45;80\n2;20;100\n",
    "percent signs": "opening (mm);passing\n0,25;10 %\n0,5;35 %\n1;80 %\n2;100 %\n",
    "as a share": "size (mm);Q3\n0.25;0.1\n0.5;0.35\n1;0.8\n2;1\n",
}


@pytest.mark.parametrize("kind", TABLES)
def test_one_curve_however_it_is_written(kind):
    found = parse_laboratory_table(TABLES[kind])
    assert found.curve.sizes == pytest.approx(SIZES)
    assert found.curve.finer == pytest.approx(FINER)
    assert found.curve.unit == "mm"
    assert found.mass == (200.0 if "gram" in kind else None)
    assert found.read_as


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("a;b\n1;2\n", "no row of titles"),
        ("size (mm);retained (%)\n1;20\n0.5;45\n0.25;25\n", "add up to 90"),
        ("size (mm);retained (%)\n1;200\n0.5;450\n0.25;250\npan;100\n", "add up to 1000"),
        ("size (mm);retained (g)\n1;20\n0.5;45\npan;10\ntotal;200\n", "not to 200"),
        ("size (mm);retained\n1;20\n0.5;45\npan;10\n", "neither grams nor percent"),
        ("size (mm);retained (% g)\n1;20\n0.5;45\n", "grams and percent"),
        ("size (mm);passing (g)\n1;20\n0.5;15\n", "sums in grams"),
        ("size (mm);passing (%)\n1;250\n0.5;45\n", "outside 0 to 100"),
        ("size (mm);passing (%)\n2;60\n1;80\n0.5;45\n", "must rise"),
        ("size (mm);passing (%)\n2;20\n1;10\n0.5;5\n", "only 20 %"),
        ("size (mm);retained (g)\n1;-20\n0.5;45\n", "negative"),
        ("size (mm);retained (g)\n1;x\n0.5;45\n", "not a number"),
        ("size (mm);retained (g)\n1;nan\n0.5;45\n", "not finite"),
        ("size (mm);retained (g)\n1;0\n0.5;0\n", "all masses are zero"),
        ("size (mm);retained (g)\n1;5\n", "at least two"),
        ("size (mm);retained (g)\n1;5\n1;6\n2;3\n", "each given once"),
        ("size (mm);retained (g)\n1;\n2;3\n0.5;1\n", "missing"),
    ],
)
def test_tables_that_do_not_add_up_are_refused(text, words):
    with pytest.raises(MeasureError, match=words):
        parse_laboratory_table(text)


def test_a_table_in_inches_is_refused():
    with pytest.raises(UnitError, match="inches"):
        parse_laboratory_table("size (in);passing (%)\n1;100\n0.5;45\n")


def test_files_of_other_encodings_are_read_and_others_refused(tmp_path):
    path = tmp_path / "sieb.csv"
    for encoding in ("utf-8-sig", "cp1252", "utf-16"):
        path.write_bytes(TABLES["german, grams"].encode(encoding))
        assert read_laboratory_table(path).curve.finer == pytest.approx(FINER)
    with pytest.raises(MeasureError, match="cannot be read"):
        read_laboratory_table(tmp_path / "none.csv")
    path.write_bytes(b"x" * 4_100_000)
    with pytest.raises(MeasureError, match="no table"):
        read_laboratory_table(path)


def test_the_gap_of_two_curves_stands_where_it_is_largest():
    table = parse_laboratory_table(TABLES["english, passing"]).curve
    scan = size_distribution(spheres(*np.linspace(0.3, 1.8, 200)))
    gap, at = largest_gap(table, scan)
    own = np.interp(np.log(table.sizes), np.log(scan.sizes), scan.finer, left=0, right=100)
    assert abs(gap) == pytest.approx(np.abs(own - table.finer).max())
    assert at in SIZES
    assert largest_gap(table, table)[0] == 0.0
