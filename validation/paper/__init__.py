# SPDX-License-Identifier: Apache-2.0
"""Simulates every figure, table and claim of the paper, and compares with the printed numbers.

A new claim is a function in one of these files and an entry in ``report.py``, with its text in
``claims.yaml``, the bounds of its numbers in ``checks.csv`` and its picture in ``charts.yaml``.
"""
