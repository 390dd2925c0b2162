# SPDX-License-Identifier: Apache-2.0
"""The version of the package; setup.py reads it from this text."""

__version__ = "3.0.0"
