# SPDX-License-Identifier: Apache-2.0
"""Tables of measurements: separators, names, units, and what is said of bad ones."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.measurement.reading import MeasurementError, Reading, read_measurement

ROWS = 20


def table(header: str, separator: str, decimal: str = ".", rows: int = ROWS) -> str:
    """Rows of k and 10 k + 0.5 below a header."""
    lines = [f"{k:.1f}{separator}{10 * k + 0.5}".replace(".", decimal) for k in range(rows)]
    return "\n".join([header, *lines]) + "\n"


def test_separators_and_headers_are_understood(tmp_path: Path) -> None:
    for text in [
        table("time (ms),x (nm)", ","),
        table("time (ms), x (nm)", ", "),
        table("time [ms];position [nm]", ";"),
        table("t / ms;x / nm", ";", ","),
        table("Time (ms)\tWeg (nm)", "\t", ","),
        table("t (ms) x (nm)", " "),
        table("t (ms)  x (nm)", "  ", ","),
        table('"time (ms)";"x (nm)"', ";"),
        table("time_ms,runner_position_nm", ","),
        "# interferometer 3\n\n" + table("# time (ms), x (nm)", ","),
        "Serial;1234\nDate;today\n" + table("time (ms);x (nm)", ";", ","),
    ]:
        file = tmp_path / "m.csv"
        file.write_text(text, encoding="utf-8")
        found = read_measurement(file)
        assert found.t == pytest.approx(1e-3 * np.arange(ROWS))
        assert found.x == pytest.approx(1e-9 * (10 * np.arange(ROWS) + 0.5))
        assert (found.source, found.u) == ("m.csv", None)


def test_units_of_length_in_every_encoding(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    for unit, metres in (("m", 1.0), ("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("μm", 1e-6)):
        for encoding in ("utf-8", "utf-8-sig", "utf-16"):
            file.write_text(table(f"t (s),x ({unit})", ","), encoding=encoding)
            assert read_measurement(file).x[0] == pytest.approx(0.5 * metres)
    file.write_bytes(table("t (s),x (µm)", ",").encode("latin-1"))  # of an old instrument
    assert read_measurement(file).x[0] == pytest.approx(0.5e-6)


def test_columns_and_units_can_be_given(tmp_path: Path) -> None:
    """By name or by number, and they outdo what the file says."""
    file = tmp_path / "m.csv"
    lines = [f"{k},{k * k},{2 * k}" for k in range(ROWS)]
    file.write_text("\n".join(["clock (s),square,double (nm)", *lines]))
    for columns in ({"t": "clock", "x": "double"}, {"t": "1", "x": 3}):
        found = read_measurement(file, Reading(columns, {"t": "us"}))  # type: ignore[arg-type]
        assert found.t == pytest.approx(1e-6 * np.arange(ROWS))
        assert found.x == pytest.approx(2e-9 * np.arange(ROWS))
    file.write_text("\n".join(lines))
    found = read_measurement(file, Reading({"u": "3"}, {"t": "s", "x": "mm", "u": "nm"}))
    assert found.x[3] == pytest.approx(9e-3)
    assert found.u is not None
    assert found.u[3] == pytest.approx(6e-9)


def lines(header: str, row: Callable[[int], str], rows: int = ROWS) -> str:
    return "\n".join([header, *map(row, range(rows))])


GOOD = table("t (s),x (nm)", ",")
BAD: list[tuple[str, str, list[str]]] = [
    (
        "not increasing",
        GOOD.replace("5.0,", "4.0,"),
        ["line 7", "time 4.0 does not come after 4.0; sort"],
    ),
    ("few rows", table("t (s),x (nm)", ",", rows=5), ["5 rows", "16 or more"]),
    ("no unit", table("t (s),x", ","), ["column 2 x (position)", "no unit", "--units x=nm"]),
    ("odd unit", table("t (s),x (furlong)", ","), ["'furlong', which is not known", "--units x="]),
    ("volts", table("t (s),x (V)", ","), ["is a voltage", "--scale x=50nm/V"]),
    ("speed", table("t (s),x (m/s)", ","), ["is in m/s, which is no unit of length", "--columns"]),
    ("no header", table("", ","), ["column 1 (time) states no unit", "--units t=ms,x=nm"]),
    ("no numbers", "hello\nworld\n", ["no row of numbers", "1 | hello"]),
    ("empty", "", ["no row of numbers"]),
    ("decimal commas", table("t (s),x (nm)", ",", ","), ["line 2 has 4 values", "separate"]),
    (
        "which column",
        lines("a (s),b (m),c (m)", lambda k: f"{k},{k},{k}"),
        ["which column is the position?", "--columns x=b", "1 a (s)", "2 b (m)", "3 c (m)"],
    ),
    (
        "over what",
        lines("x,y", lambda k: f"{k},{k}"),
        ["which column is the position?", "--columns x=y --units x=nm,t=ms"],
    ),
    (
        "mostly words",
        lines("t (s),x (nm)", lambda k: f"{k},{k if k % 3 else 'red'}", 40),
        ["13 of 39 lines are no rows of numbers", "line 5 ('3,red')"],
    ),
    (
        "thousands or decimals",
        lines("t (ms);x (nm)", lambda k: f"{k};{k * 300:,}"),
        ["'1,200'", "--decimal"],
    ),
    (
        "units in the cells",
        lines("t,x", lambda k: f"{k}.5 ms,{k}.25 nm"),
        ["line 2 has a unit behind a number ('0.5 ms')", "as in 'x (nm)'"],
    ),
    (
        "two measurements",
        GOOD + GOOD,
        ["line 23", "time 0.0 does not come after 19.0", "--rows 1:20 or --rows 21:"],
    ),
]


@pytest.mark.parametrize(("text", "words"), [b[1:] for b in BAD], ids=[b[0] for b in BAD])
def test_a_bad_table_is_refused_with_place_and_cure(
    text: str, words: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "m.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(MeasurementError) as error:
        read_measurement(file)
    for word in [str(file), *words]:
        assert word in str(error.value)


def test_what_is_no_row_is_left_out_and_told(tmp_path: Path) -> None:
    for damage, left_out, note in [
        ((",50.5", ",abc"), 1, "1 line is left out, not being numbers: line 7 ('5.0,abc')"),
        ((",50.5", ",50.5x"), 1, "line 7"),
        ((",50.5", ",50.5,7"), 1, "line 7"),
        (("5.0,50.5", "Time (s),x (nm)"), 1, "line 7"),
        (("5.0,50.5\n", "5.0,50.5\n\n# a remark\n"), 0, None),
        ((",50.5", ",nan"), 1, "1 of 20 rows have a gap"),
        ((",50.5", ","), 1, "1 of 20 rows have a gap"),
        ((",50.5", ",9.9E+37"), 1, "1 of 20 rows have a gap"),
        ((",50.5", ",-∞"), 1, "1 of 20 rows have a gap"),
        (("5.0,50.5", "5.0"), 1, "1 of 20 rows have a gap"),
        (("19.0,190.5\n", "19.0,190.5\nMean,95.5\n"), 0, "line 22 ('Mean,95.5')"),
        (("19.0,190.5\n", "19.0,"), 1, "line 21 ('19.0,')"),  # cut off
        (("5.0,50.5", '"5.0",50,5"'), 1, "line 7"),  # a mark of quotation that is missing
    ]:
        file = tmp_path / "m.csv"
        file.write_text(GOOD.replace(*damage), encoding="utf-8")
        found = read_measurement(file)
        assert len(found.t) == ROWS - left_out
        assert found.x == pytest.approx(1e-9 * (10 * found.t + 0.5))
        assert len(found.notes) == (note is not None)
        assert (note or "") in "".join(found.notes)


def test_a_stray_comma_makes_no_thousands_of_decimals(tmp_path: Path) -> None:
    """In a header, or with what is behind it in a cell that a mark of quotation begins."""
    file = tmp_path / "m.csv"
    text = lines("t (s),x (nm)", lambda k: f"{k + 1}.000,{k + 1}.250")
    for stray in (text.replace("\n5.0", '\n".0'), "Points\t1,000\n" + text.replace(",", "\t")):
        file.write_text(stray)
        assert read_measurement(file).t[:2].tolist() == [1.0, 2.0]


def test_names_of_columns_are_shortened_in_messages(tmp_path: Path) -> None:
    """A line of digits that is no header was repeated whole, and hid what is asked."""
    path = tmp_path / "motion.csv"
    path.write_text("\n\n0\n0 " + "9" * 400 + " " + "9" * 400 + "\n0.0")
    with pytest.raises(MeasurementError, match="what is the rate of the samples") as refused:
        read_measurement(path)
    assert len(str(refused.value)) < 1200
    path.write_text(table(f"time (ms),{'x' * 300}", ","))
    with pytest.raises(MeasurementError, match=r"column 2 x{60}\.\.\. "):
        read_measurement(path)


def test_a_missing_column_is_named_with_those_there_are(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    file.write_text(GOOD)
    with pytest.raises(MeasurementError, match=r"no column 'y'; the columns are: 1 t \(s\), 2 x"):
        read_measurement(file, Reading({"x": "y"}))
    with pytest.raises(MeasurementError, match="no quantity 'q'; known: t"):
        read_measurement(file, Reading({"q": "1"}))


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    for content, words in ((b"PK\x03\x04\0\0\0", "neither text nor a known"), (b"\0", "no row")):
        file.write_bytes(content)
        with pytest.raises(MeasurementError, match=words):
            read_measurement(file)
    with pytest.raises(MeasurementError, match="No such file"):
        read_measurement(tmp_path / "none.csv")


def test_metres_and_seconds_behind_a_name_are_units(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    for header in ("time_s,position_m", "t_s,stage_x_m", "time (s),displacement m"):
        file.write_text(table(header, ","))
        assert read_measurement(file).x[1] == pytest.approx(10.5)
    file.write_text(table("time_s,item_m", ","))  # which may be a word
    with pytest.raises(MeasurementError, match="states no unit"):
        read_measurement(file)


def test_lines_of_all_kinds_between_the_rows_change_no_row(tmp_path: Path) -> None:
    file = tmp_path / "m.csv"
    rows = [f"{k},{2 * k}" for k in range(4000)]
    others = {40: "", 1000: "# a comment", 2000: '"2000","4000"', 3000: "again", 3999: "3999,OVER"}
    file.write_text("t (s),x (nm)\n" + "\n".join(others.get(k, row) for k, row in enumerate(rows)))
    found = read_measurement(file)
    kept = [k for k in range(4000) if k not in (40, 1000, 3000, 3999)]
    assert found.t.tolist() == kept
    assert found.x == pytest.approx(2e-9 * np.array(kept))
    assert any("'again'" in note for note in found.notes)
