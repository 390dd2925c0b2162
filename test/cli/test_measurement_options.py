# SPDX-License-Identifier: Apache-2.0
"""The options that say how a measurement is read; a question is answered by the option it names."""

import argparse
import shlex
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.cli.measurement_options import add_measurement_options, measurement_of
from stickslip_ros.simulation.motion import Motion

VALUES = [(1e-5 * k, round(0.1 * k % 1.7, 3)) for k in range(50)]


def read(path: Path, *arguments: str) -> Motion:
    parser = argparse.ArgumentParser()
    add_measurement_options(parser)
    return measurement_of(parser.parse_args(arguments), path)[0]


def write(path: Path, head: str, form: str) -> Path:
    path.write_text(head + "".join(form.format(k=k, t=t, v=v) for k, (t, v) in enumerate(VALUES)))
    return path


def test_a_question_names_the_options_that_answer_it(tmp_path: Path) -> None:
    for head, form, asked in [
        ("Time (s),CH1 (V),CH2 (V)\n", "{t:.6f},{v},0\n", "--columns x=CH1 --scale x=50nm/V"),
        ("", "{t:.6f};{v}\n", "--units t=ms,x=nm"),
        ("x (nm)\n", "{v}\n", "--rate 10kHz"),
        ("Clock;Out (V);In (V)\n", "{t:.6f};{v};0\n", "--columns x=Out --scale x=50nm/V"),
        ("X,CH1,Start,Increment\nSequence,Volt,0,1e-5\n", "{k},{v},,\n", "--scale x=50nm/V"),
        ("__time,/a/position,/b\n", "{t:.6f},{v},1\n", "--columns x=/a/position --units x=nm"),
        ("t (ms);x (nm)\n", "{t:.6f};{v}\n", None),
    ]:
        path = write(tmp_path / "axis.csv", head, form)
        given: list[str] = []
        for _ in range(3):
            try:
                found = read(path, *given)
                break
            except StickslipError as error:
                (line,) = (text for text in str(error).splitlines() if "add, for example: " in text)
                options = line.partition("add, for example: ")[2]
                if not given and asked is not None:
                    assert options.startswith(asked)
                given += shlex.split(options)
        else:
            pytest.fail("asked again and again")
        assert bool(given) is (asked is not None)
        scale = 50e-9 if any("50nm/V" in text for text in given) else 1e-9
        assert found.x == pytest.approx([scale * v for _, v in VALUES])


def test_rate_rows_sign_angle_and_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "axis.csv", "begun\nx (nm)\n", "{v}\n")
    found = read(path, "--rate", "100 kHz", "--rows", "11:40", "--from", "1.2e-4",
                 "--scale", "x=-1", "--sensor-angle", "60")  # fmt: skip
    assert found.t == pytest.approx(1e-5 * np.arange(12, 40))
    assert found.x == pytest.approx([-2e-9 * v for _, v in VALUES[12:40]])
    path = write(tmp_path / "axis.csv", "t (s),x (nm)\n", "{t:.6f},{v}\n")
    path.write_text(f"{path.read_text()}the end\n")
    assert len(read(path).t) == len(VALUES)
    assert capsys.readouterr().err == (
        "axis.csv: 1 line is left out, not being numbers: line 52 ('the end')\n"
    )


def test_lost_fringes_are_counted_and_taken_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    jumped = [v + 316.4 * (k > 9) - 632.8 * (k > 30) for k, (_, v) in enumerate(VALUES)]
    path = tmp_path / "axis.csv"
    rows = "".join(f"{k * 1e-5:.6f},{v}\n" for k, v in enumerate(jumped))
    path.write_text("t (s),x (nm)\n" + rows)
    assert read(path).x == pytest.approx([1e-9 * v for v in jumped])
    found = read(path, "--wavelength", "632.8nm")
    assert found.x == pytest.approx([1e-9 * v for _, v in VALUES])
    assert capsys.readouterr().err == "axis.csv: 2 jumps by whole fringes of 316.4 nm taken out\n"


def test_bad_use_is_told(tmp_path: Path) -> None:
    for arguments, words in [
        ("--rate 0", "rate is 0 Hz; it has to lie between 0 and inf Hz, such as 10kHz"),
        ("--rows 5", "write it as 1:5000 or 5001:"),
        ("--rows 9:3", "the last must not be before the first"),
        ("--sensor-angle 90", "between -85 and 85"),
        ("--wavelength 633m", "wavelength is 633 m; it has to lie between 1e-07 and 2e-05 m"),
        ("--scale x=nm/furlong", "'nm/furlong' gives no length by units that are known; write it"),
        ("--scale x=5nm/0V", "'5nm/0V' gives no length"),
        ("--scale x=5V", "'5V' gives no length by units that are known; write it as 50nm/V"),
        ("--columns nix", "'nix' is not of the form t=...,x=..."),
        ("--units y=nm", "there is no quantity 'y'; known: t (time), x (position)"),
        ("--rows 1:9", "9 rows of numbers; 16 or more are needed"),
        ("--to 1e-5", "2 samples lie between --from and --to"),
    ]:
        path = write(tmp_path / "axis.csv", "t (s),x (nm)\n", "{t:.6f},{v}\n")
        with pytest.raises(StickslipError) as error:
            read(path, *shlex.split(arguments))
        assert words in str(error.value)
