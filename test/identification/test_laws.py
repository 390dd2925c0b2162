# SPDX-License-Identifier: Apache-2.0
"""Which friction law made a trace, from an integrator that shares no code with the package."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from bench_traces import Axis, Drive
from experiments import small, truth_of
from other_axes import Other, other_trace

from stickslip_ros.identification import (
    RANKED_LAWS,
    Fit,
    IdentificationError,
    identify,
    read_curve,
)
from stickslip_ros.identification.fit import RankedLaw
from stickslip_ros.motion.motion import Motion
from stickslip_ros.parameters import Parameters

AXIS = Axis(preload=0.6, mass=5e-3, sigma_1=7.0)


def trace_of(law: str, preload: float = 0.6) -> tuple[Parameters, Motion]:
    """What is known of a drive with a contact of a law, and its trace with 1 nm of noise."""
    drive = Drive(10, frequency=700.0, amplitude=280.0, pause=4e-3)
    t, x = other_trace(replace(AXIS, preload=preload), Other(law=law), drive, 5e5, 1e-9, 3)
    known = {"preload": preload, "mass": 5e-3, "frequency": 700.0, "amplitude": 280.0}
    start = {name: 1.5 * value for name, value in truth_of(AXIS).items()}
    if preload != AXIS.preload:  # several are fitted with Eq. 13 and 14, which are others at first
        start = {"sigma_0_slope": 7e6, "z_ba_slope": 3e-8, "sigma_1": 10.0, "sigma_0ss": 1.5e7}
    return Parameters.of({**known, **start}), Motion("lab", t, x)


@pytest.mark.long
@pytest.mark.parametrize(
    ("law", "other", "preloads"),
    [("ceim", "lugre", (0.6,)), ("lugre", "ceim", (0.6,)), ("ceim", "lugre", (0.4, 0.8))],
)
def test_the_law_of_the_axis_is_ranked_first(
    law: str, other: str, preloads: tuple[float, ...]
) -> None:
    """Without one of two preloads, the constants of Eq. 13 and 14 had no value that predicts."""
    found = identify([trace_of(law, one) for one in preloads], laws=["ceim", "lugre"])
    first, second = found.laws[:2]
    assert (first.law, second.law) == (law, other)
    assert (first.score, first.likely, second.likely) == (0.0, True, False)
    assert second.score > 50.0
    assert first.residual < min(1e-9, second.residual)
    told = json.loads(json.dumps(found.as_json(), allow_nan=False))["laws"]
    assert [one["law"] for one in told] == [one.law for one in found.laws]
    if len(preloads) == 1:
        sigma_0 = truth_of(AXIS)["sigma_0"]
        assert told[0]["parameters"]["sigma_0"] == pytest.approx(sigma_0, rel=0.02)


def test_laws_that_recordings_do_not_tell_apart_are_both_likely() -> None:
    found = object.__new__(Fit)
    few, more = (RankedLaw(name, {}, score, 1e-9, True) for name, score in (("a", 0.0), ("b", 3.0)))
    object.__setattr__(found, "laws", (few, more))
    assert found.laws_alike.startswith("a, b: these measurements do not tell them apart")
    object.__setattr__(found, "laws", (few, replace(more, likely=False)))
    assert found.laws_alike == ""


@pytest.mark.long
def test_a_law_under_another_name_scores_alike() -> None:
    """With mu_s = mu_k, epm_fix is the CEIM with a free z_ss."""
    known, motion = trace_of("ceim")
    laws = identify([(known.replace(mu_s=0.2, mu_k=0.2), motion)], laws=["epm_fix", "free"]).laws
    assert {one.law for one in laws} == {"epm_fix", "free"}
    assert laws[1].score < 1.0
    assert all(one.likely for one in laws)


def test_a_law_that_is_not_known_is_refused() -> None:
    with pytest.raises(IdentificationError, match=r"no_law is no law to rank; known are ceim, "):
        identify([small()[1]], laws=["no_law"])
    assert set(RANKED_LAWS) >= {"ceim", "lugre", "epm_calc", "epm_fix", "free"}


def test_a_table_alone_predicts_no_run(tmp_path: Path) -> None:
    table = tmp_path / "steps.csv"
    table.write_text("amplitude (V),step_size (nm)\n200,60\n250,85\n300,110\n")
    with pytest.raises(IdentificationError, match="give one \\(--run\\)"):
        identify([], ["z_ba"], curves=[(Parameters.of({}), read_curve(table))], laws=["ceim"])


@pytest.mark.long
def test_a_law_that_is_ranked_keeps_to_the_bounds() -> None:
    """Without bounds, a LuGre law leaves a tenth of the damping of this contact."""
    axis, run = small()
    bounds = {name: (0.8 * true, 1.25 * true) for name, true in truth_of(axis).items()}
    (lugre,) = identify([run], bounds=bounds, laws=["lugre"]).laws
    assert lugre.parameters["sigma_1"] == pytest.approx(bounds["sigma_1"][0])
