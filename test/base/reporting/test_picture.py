# SPDX-License-Identifier: Apache-2.0
"""Pictures for papers, from the data that pages show."""

from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.base.reporting.page import Figure, axis_of, layout_of, line_of, thin_columns
from stickslip_ros.base.reporting.picture import picture_of, picture_of_plots, save_picture

X = np.linspace(0.0, 1.0, 20)


def figure() -> Figure:
    """Two axes below each other, an area with a name, and a gap in a line."""
    y = np.where(X[3] == X, np.nan, X)
    shape = {"x0": 0.2, "x1": 0.4, "yref": "paper", "fillcolor": "#dfe8d3"}
    return {
        "data": [
            line_of(X, y, "step", "#1f4e9c", "nm", "s"),
            line_of(X, 2.0 * X, "backstep", "#c46a1b", "nm", "s", mode="markers", yaxis="y2"),
            {
                "type": "scatter",
                "mode": "markers",
                "x": [None],
                "y": [None],
                "name": "stick",
                "marker": {"symbol": "square", "color": "#dfe8d3"},
            },
        ],
        "layout": layout_of(
            400,
            xaxis=axis_of("time (s)", anchor="y2"),
            yaxis=axis_of("position (nm)", domain=[0.5, 1.0]),
            yaxis2=axis_of("residual (nm)", domain=[0.0, 0.4]),
            shapes=[shape],
            annotations=[{"x": 0.3, "y": 1, "yanchor": "bottom", "text": "run 1"}],
        ),
    }


def test_text_stays_text_and_fonts_are_embedded(tmp_path: Path) -> None:
    for name in ("a.svg", "a.pdf", "a.png"):
        save_picture(tmp_path / name, picture_of_plots([figure(), figure()], "a title"))
    svg = (tmp_path / "a.svg").read_text(encoding="utf-8")
    for text in (
        "a title",
        "time (s)",
        "position (nm)",
        "residual (nm)",
        "run 1",
        "backstep",
        "stick",
    ):
        assert f">{text}</text>" in svg, text
    pdf = (tmp_path / "a.pdf").read_bytes()
    assert b"/FontFile2" in pdf  # TrueType, which Matplotlib calls Type 42
    assert b"/Type3" not in pdf
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_pictures_are_one_or_two_columns_wide(tmp_path: Path) -> None:
    """85 and 170 mm, in points of an SVG."""
    save_picture(tmp_path / "a.svg", picture_of(lambda axes: axes.plot(X, X)))
    save_picture(tmp_path / "b.svg", picture_of_plots([figure()], "a title"))
    for name, width in (("a.svg", 85.0), ("b.svg", 170.0)):
        text = (tmp_path / name).read_text(encoding="utf-8")
        found = float(text.partition('width="')[2].partition("pt")[0])
        assert found == pytest.approx(width / 25.4 * 72.0, rel=1e-3)


def test_thinning_keeps_the_peaks() -> None:
    t = np.linspace(0.0, 1.0, 1_000_000)
    x = np.zeros_like(t)
    x[123_456], x[654_321] = 1.0, -1.0
    thin_t, thin_x = thin_columns(t, x, count=1000)
    assert len(thin_t) <= 1002
    assert (thin_x.max(), thin_x.min()) == (1.0, -1.0)
    assert (np.diff(thin_t) > 0.0).all()
