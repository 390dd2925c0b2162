# SPDX-License-Identifier: Apache-2.0
"""The one table of parameters: what it takes, what it refuses, and in which words."""

import math
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from stickslip_ros.physics.parameters import (
    PARAMETERS,
    Parameter,
    ParameterError,
    Parameters,
    parameter,
    parse_assignment,
    read_yaml,
    yaml_text,
)

NUMBERS = [row for row in PARAMETERS.values() if isinstance(row.default, float)]
GOOD_HEAD = "/**:\n  ros__parameters:\n"


def test_every_row_accepts_its_default_and_describes_itself() -> None:
    """A default outside its own range would refuse every run that names it."""
    for row in PARAMETERS.values():
        assert row.check(row.default) == row.default
        assert row.parse(str(row.default)) == row.default
        assert row.description
        if row.kind in (int, float):
            assert row.reason
            assert math.isfinite(row.low) and math.isfinite(row.high)
            assert row.low < row.high


def test_a_full_set_is_the_defaults_with_values_laid_over_them() -> None:
    assert Parameters.of({}) == Parameters()
    p = Parameters.of({"preload": 1})
    assert p.friction.preload == 1.0
    assert type(p.friction.preload) is float
    assert p.replace(preload=PARAMETERS["preload"].default) == Parameters()
    assert Parameters.of(p) is p


def test_a_full_set_never_changes() -> None:
    """A change makes another set: what an axis was made of cannot be changed under it."""
    p = Parameters()
    with pytest.raises(FrozenInstanceError):
        p.friction.preload = 99.0  # type: ignore[misc]
    assert p.replace(preload=2.0).friction.preload == 2.0
    assert p == Parameters()


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"actuator_resonance": 1e-200}, "between 1 and 1e+12 Hz, or be 0: a stack of a kilometre"),
        ({"amplifier_bandwidth": 5e-324}, "between 1 and 1e+12 Hz, or be 0: below 1 Hz"),
        ({"sigma_0ss": 5e-324, "mu": 10.0}, "sigma_0ss is 4.94066e-324 N/m; it has to lie between"),
        ({"latency": 1e-320}, "between 1e-30 and 1 s, or be 0: runners"),
        ({"force": -1e-320}, "between 1e-30 and 1000 N, or be 0: the weight of 100 kg"),
    ],
)
def test_no_absurd_value_passes(values: dict[str, float], complaint: str) -> None:
    """By any way in: a call, an assignment, a change."""
    assigned = dict(parse_assignment(f"{name}={value}") for name, value in values.items())
    for way in (Parameters.of, lambda v: Parameters.of(**v), lambda v: Parameters().replace(**v)):
        for bad in (values, assigned):
            with pytest.raises(ParameterError) as refusal:
                way(bad)
            assert complaint in str(refusal.value)


def test_a_set_comes_from_a_mapping_a_file_or_names(tmp_path: Path) -> None:
    file = tmp_path / "some.yaml"
    file.write_text(GOOD_HEAD + "    preload: 2000 mN\n")
    wanted = Parameters().replace(preload=2.0, mass=1e-3)
    assert Parameters.of(file, mass="1g") == wanted
    assert Parameters.of(str(file), mass=1e-3) == wanted
    file.write_text("preload: 2\nmass: 1e-3\n")
    assert Parameters.of(file) == wanted
    assert Parameters.of({"preload": 2.0}, mass=1e-3) == wanted
    assert Parameters.of(preload=2.0, mass=1e-3) == wanted
    assert Parameters.of(Parameters.of(file), mass=1e-3) == wanted
    assert "preload: 2.0" in yaml_text(wanted)
    assert "mass" not in yaml_text(Parameters()) and "mass" in yaml_text(Parameters(), {"mass"})
    with pytest.raises(ParameterError, match=r"0\.6 is no set of parameters; give a file"):
        Parameters.of(0.6)  # type: ignore[arg-type]
    named = Parameters.of("table1_vibration.yaml")
    assert named != Parameters()
    with pytest.raises(ParameterError, match=r"some.yaml: there is no parameter"):
        file.write_text(GOOD_HEAD + "    preloud: 2\n")
        Parameters.of(file)


def test_flat_names_are_those_of_the_table_in_its_order() -> None:
    assert list(Parameters().flat().items()) == [
        (name, row.default) for name, row in PARAMETERS.items()
    ]


def test_what_is_not_set_is_none_and_is_written_as_before() -> None:
    """0, or an empty text, in ROS, YAML and bags; typed attributes have None."""
    for row in filter(lambda row: row.optional, PARAMETERS.values()):
        for unset in (None, row.kind()):
            p = Parameters.of({row.name: unset})
            assert getattr(getattr(p, row.group), row.name) is None
            assert p.flat()[row.name] == row.kind()
            assert type(p.flat()[row.name]) is row.kind
    assert Parameters.of(Parameters().flat()) == Parameters()


def test_columns_have_a_point_for_each_entry() -> None:
    """nan is "not set" in a column, as None is in a set of one point."""
    p = Parameters.of({"preload": np.array([1.0, 2.0]), "sigma_0": np.array([0.0, 3e6])})
    np.testing.assert_array_equal(p.friction.sigma_0, [np.nan, 3e6])
    np.testing.assert_array_equal(p.flat()["sigma_0"], [0.0, 3e6])
    assert p.point(0) == Parameters.of({"preload": 1.0})
    assert p.point(1) == Parameters.of({"preload": 2.0, "sigma_0": 3e6})


def test_values_of_numpy_are_taken_as_numbers() -> None:
    p = Parameters.of({"preload": np.float64(2.0), "sensor_seed": np.int64(3)})
    assert (type(p.friction.preload), type(p.sensor.sensor_seed)) == (float, int)


@given(some.sampled_from(NUMBERS), some.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_taken_as_it_is_or_refused_with_its_limits(row: Parameter, x: float) -> None:
    """In range: unchanged, also through text. Out of range: value and both limits are named."""
    if row.low <= x <= row.high and (x == 0.0 or abs(x) >= row.least):
        assert row.check(x) == x
        assert row.parse(repr(x)) == x
    else:
        with pytest.raises(ParameterError) as refusal:
            row.check(x)
        low = row.least if 0.0 < abs(x) < row.least else row.low
        for part in (row.name, f"{x:g}", f"{low:g}", f"{row.high:g}", row.unit, row.reason):
            assert part in str(refusal.value)


def test_what_is_no_finite_number_is_refused_by_name() -> None:
    """Also whole numbers too large for a float: refused, not an OverflowError."""
    for row in NUMBERS:
        for value in (math.nan, math.inf, -math.inf, 10**400, -(10**400), "a lot", True, [1.0]):
            with pytest.raises(ParameterError, match=rf"^{row.name} is .*number"):
                row.check(value)


def test_none_is_no_number_and_a_number_no_text() -> None:
    with pytest.raises(ParameterError, match="preload is None; it has to be a number"):
        Parameters.of({"preload": None})
    with pytest.raises(ParameterError, match="model is 3; it has to be a text"):
        parameter("model").check(3)


def test_a_misspelt_name_brings_the_right_one_another_the_list() -> None:
    for wrong, right in (("preloud", "preload"), ("sigma0", "sigma_0"), ("Mass", "mass")):
        words = rf"no parameter '{wrong}'; did you mean .*{right}"
        with pytest.raises(ParameterError, match=words):
            Parameters.of({wrong: 1.0})
    with pytest.raises(ParameterError, match="known: model, preload, mu"):
        parameter("qqqqqq")


def test_an_assignment_is_read() -> None:
    assert parse_assignment("preload=1") == ("preload", 1.0)
    assert parse_assignment(" mass = 3e-3 ") == ("mass", 3e-3)
    assert parse_assignment("model=epm_fix") == ("model", "epm_fix")
    assert parse_assignment("force=-0.5") == ("force", -0.5)


def test_a_bad_assignment_is_refused() -> None:
    for text, complaint in [
        ("preload", "not of the form NAME=VALUE"),
        ("preload=", "preload is ''; it has to be a number"),
        ("preload=1V", "preload is '1V'; it has to be a number: '1V' is in V; write"),
        ("=1", "no parameter ''"),
    ]:
        with pytest.raises(ParameterError) as refusal:
            Parameters.of(dict([parse_assignment(text)]))
        assert complaint in str(refusal.value)


def test_a_file_is_laid_over_the_defaults_with_numbers_as_ros_reads_them(tmp_path: Path) -> None:
    file = tmp_path / "some.yaml"
    file.write_text(GOOD_HEAD + "    preload: 2\n    z_ba: 1.0e-8\n    model: lugre\n")
    p = read_yaml(file)
    assert p == Parameters.of({"preload": 2.0, "z_ba": 1e-8, "model": "lugre"})
    assert type(p.friction.preload) is float
    file.write_text(GOOD_HEAD + "    z_ba: 1e-8\n    sigma_0: 7.0e6\n    preload: 1E0\n")
    assert read_yaml(file) == Parameters.of(z_ba=1e-8, sigma_0=7e6, preload=1.0)


def test_a_file_that_configures_other_nodes_is_taken(tmp_path: Path) -> None:
    for text, values in [
        ("/stickslip_axis:\n  ros__parameters: {preload: 2.0}\n", {"preload": 2.0}),
        ("/lab/stickslip_axis:\n  ros__parameters: {preload: 2.0}\n", {"preload": 2.0}),
        ("lab:\n  stickslip_axis:\n    ros__parameters: {preload: 2.0}\n", {"preload": 2.0}),
        ("my_axis:\n  ros__parameters: {preload: 2.0}\n", {"preload": 2.0}),
        (GOOD_HEAD + "    preload: 2.0\nx:\n  ros__parameters: {mass: 1e-3}\n", {"preload": 2.0}),
    ]:
        file = tmp_path / "some.yaml"
        file.write_text(f"{text}camera:\n  ros__parameters: {{gain_db: 3, lens: {{zoom: 2}}}}\n")
        assert read_yaml(file) == Parameters.of(values)


def test_a_bad_file_is_refused_by_its_name(tmp_path: Path) -> None:
    for text, complaint in [
        (
            "a:\n  ros__parameters: {x: 1}\nb:\n  ros__parameters: {y: 1}\n",
            "configures /a, /b, none with a parameter of an axis",
        ),
        (GOOD_HEAD + "    preloda: 1.0\n", "no parameter 'preloda'; did you mean preload"),
        (GOOD_HEAD + "    preload: -5.0\n", "preload is -5 N; it has to lie between"),
        (GOOD_HEAD + "    preload: .nan\n", "preload is nan; it has to be a finite number"),
        (GOOD_HEAD + "    mass:\n", "mass is None; it has to be a number"),
        ("/stickslip_axis:\n  ros__parameters: {preloda: 1}\n", "did you mean preload"),
        (GOOD_HEAD + "    3: 1.0\n", "no parameter '3'"),
        (GOOD_HEAD + "    - preload\n", "holds no names with values"),
        ("preloda: 1.0\n", "'preloda' has no ros__parameters; a file starts with"),
        ("preload: 1.0\nmas: 1e-3\n", "there is no parameter 'mas'; did you mean mass"),
        ("/**:\n", "'/**' has no ros__parameters"),
        (GOOD_HEAD + "    preload: 1:30\n", "preload is '1:30'; it has to be a number"),
        (GOOD_HEAD + f"    preload: {'9' * 100}\n", "preload is 1e+100 N; it has to lie between"),
        ("", "holds no names with values"),
        ("- 1\n", "holds no names with values"),
        ("a: [1\n", "is not a YAML file"),
    ]:
        file = tmp_path / "some.yaml"
        file.write_text(text)
        with pytest.raises(ParameterError) as refusal:
            read_yaml(file)
        assert str(file) in str(refusal.value)
        assert complaint in str(refusal.value)
        assert "\n" not in str(refusal.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"cannot read .*none.yaml: No such file"):
        read_yaml(tmp_path / "none.yaml")
    with pytest.raises(ParameterError, match=r"cannot read .*: it is not a regular file"):
        read_yaml(tmp_path)
    (tmp_path / "latin").write_bytes(b"a: \xe9\n")
    with pytest.raises(ParameterError, match="is not a YAML file"):
        read_yaml(tmp_path / "latin")


def test_axis_names_make_joint_names() -> None:
    """Joints are named after the axis, so its name has to be one."""
    for name in ("", "x y", "1st", "a/b"):
        with pytest.raises(ParameterError, match=r"axis_name is .* a letter, then letters"):
            Parameters.of({"axis_name": name})


def test_parameters_of_every_node_pass(tmp_path: Path) -> None:
    """A file for a node may set what every node has; the command line reads the same file."""
    path = tmp_path / "axis.yaml"
    path.write_text(
        "/**:\n  ros__parameters:\n    use_sim_time: true\n    preload: 1.0\n"
        "    qos_overrides: {/x: {publisher: {depth: 1}}}\n"
    )
    assert read_yaml(path) == Parameters.of({"preload": 1.0})


@pytest.mark.parametrize("name", ["hysteresis_file", "waveform_table"])
def test_a_file_that_a_file_names_is_looked_for_beside_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the current folder is; what is not beside it is left to the current folder."""
    folder = tmp_path / "drives"
    folder.mkdir()
    (folder / "loop.yaml").write_text("", encoding="utf-8")
    for where in ("loop.yaml", "elsewhere.yaml"):
        text = f"/**:\n  ros__parameters:\n    {name}: {where}\n"
        (folder / f"of_{where}").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert read_yaml(Path("drives/of_loop.yaml")).flat()[name] == str(Path("drives/loop.yaml"))
    assert read_yaml(Path("drives/of_elsewhere.yaml")).flat()[name] == "elsewhere.yaml"
