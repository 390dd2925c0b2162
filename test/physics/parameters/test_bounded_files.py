# SPDX-License-Identifier: Apache-2.0
"""Parameters: values with their units, files from strangers, and what they may not contain."""

import math
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_ros.physics.parameters.bounded_files import load_texts, load_values
from stickslip_ros.physics.parameters.row import read_quantity

CONFIG = Path(__file__).resolve().parents[3] / "config"


def test_what_would_harm_is_refused_at_once() -> None:
    for text, problem in [
        ("a: 1\nb: 2\na: 3\n", "'a' stands there twice, again in line 3"),
        ("x: {a: 1, a: 2}\n", "'a' stands there twice"),
        ("a: " + "9" * 5000, "a number of 5000 digits"),
        ("a: " + "[" * 3000 + "]" * 3000, "nested more than 20 deep"),
        ("[" * 100_000, "nested more than 20 deep"),
        ("{a: " * 3000 + "}" * 3000, "nested more than 20 deep"),
        ("a: [", "not YAML"),
        ("a: !!python/object/apply:os.getcwd []", "not YAML"),
        ("a: &a [*a]", "a value inside itself"),
        ("# " + "x" * 2_000_000, "characters of YAML"),
    ]:
        began = time.process_time()
        with pytest.raises(ValueError, match=problem) as refused:
            load_values(text)
        assert "\n" not in str(refused.value) and len(str(refused.value)) < 400
        assert time.process_time() - began < 1.0


@pytest.mark.parametrize("text", ["1:30", "-1:30", "1:30.5", "190:20:30"])
def test_a_time_is_no_number(text: str) -> None:
    assert not isinstance(yaml.safe_load(text), str)  # but for PyYAML, as YAML 1.1 has it
    assert load_values(text) == text


def test_files_of_ours_mean_what_they_meant() -> None:
    for file in CONFIG.glob("*.yaml"):
        text = file.read_text(encoding="utf-8")
        assert load_values(text) == yaml.safe_load(text)


def _is_no_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return True
    return False


#: 1e100 is a number to us, as in YAML 1.2 and for ros2; PyYAML takes it for a text.
TEXTS = st.text().filter(_is_no_number)
SCALARS = st.one_of(
    st.integers(-(2**64), 2**64), st.floats(allow_nan=False), st.booleans(), st.none(), TEXTS
)


@settings(max_examples=40)
@given(st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(TEXTS, inner)))
def test_all_else_is_as_with_pyyaml(value: object) -> None:
    text = yaml.safe_dump(value)
    try:
        found = load_values(text)
    except ValueError as error:
        assert "nested more than" in str(error)
        return
    assert found == yaml.safe_load(text)


def test_texts_stay_texts() -> None:
    assert load_texts("a: 1\nb: [yes, 1:30, ~]") == {"a": "1", "b": ["yes", "1:30", "~"]}
    with pytest.raises(ValueError, match="twice"):
        load_texts("a: 1\na: 2")


def test_a_unit_may_be_typed_with_a_prefix_and_a_sign() -> None:
    for text, unit, expected in (
        ("1000", "Hz", 1000.0),
        ("1kHz", "Hz", 1000.0),
        ("-5um", "m", -5e-6),
        ("\u22125 \u00b5m", "m", -5e-6),
        ("100nm", "m", 100e-9),
        ("200V", "V", 200.0),
        ("3 g", "kg", 3e-3),
        ("0.003kg", "kg", 3e-3),
        ("+1.5e-3 N", "N", 1.5e-3),
        ("100 V/us", "V/us", 100.0),
        ("90deg", "rad", math.pi / 2.0),
        ("30deg", "deg", 30.0),
        ("9 N/µm", "N/m", 9e6),
        ("9kN/m", "N/m", 9e3),
        ("5 %", "", 0.05),
        ("-inf", "m", -math.inf),
    ):
        assert read_quantity(text, unit) == expected, text


def test_what_could_mean_something_else_is_refused_with_the_cure() -> None:
    for text, unit, cure in (
        ("1,5um", "m", "write 1.5 with a point"),
        ("20 a", "Hz", "'20 a' is in a; write a number, such as 1.5 Hz"),
        ("1 rad/s", "Hz", "is in rad/s"),
        ("5 M", "m", "is in M"),
        ("5 Nm", "N", "is in Nm"),
        ("um", "m", "'um' is not a number, such as 1.5 m"),
        ("", "", "'' is not a number, such as 1.5"),
        ("1 2", "m", "is in 2"),
    ):
        with pytest.raises(ValueError) as error:
            read_quantity(text, unit)
        assert cure in str(error.value), text
