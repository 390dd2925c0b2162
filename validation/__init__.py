# SPDX-License-Identifier: Apache-2.0
"""What proves the package and no user runs: benchmark, soak, campaigns; not in the wheel."""
