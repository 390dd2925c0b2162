# SPDX-License-Identifier: Apache-2.0
"""The sample measurements are what their integrator makes, to the digits written."""

import numpy as np
import pytest
from samples import FOLDER, SAMPLES


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_is_what_the_integrator_makes(name: str) -> None:
    make, digits = SAMPLES[name]
    columns = make()
    with (FOLDER / name).open(encoding="utf-8") as file:
        assert file.readline().strip() == ",".join(columns)
        written = np.loadtxt(file, delimiter=",")
    for values, column, places in zip(columns.values(), written.T, digits, strict=True):
        np.testing.assert_allclose(column, values, rtol=0.0, atol=0.51 * 10.0**-places)


def test_the_folder_holds_nothing_else() -> None:
    assert {file.name for file in FOLDER.iterdir()} == {"README.md", *SAMPLES}
