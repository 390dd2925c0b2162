# SPDX-License-Identifier: Apache-2.0
"""Baselines for the tasks of control, on the public API alone: `make control`."""
