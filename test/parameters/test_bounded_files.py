# SPDX-License-Identifier: Apache-2.0
"""YAML from strangers: what it may not contain, and that all else means what PyYAML says."""

import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.parameters.bounded_files import load_texts, load_values

CONFIG = Path(__file__).resolve().parent.parent.parent / "config"


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


@pytest.mark.slow
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
