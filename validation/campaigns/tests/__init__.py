# SPDX-License-Identifier: Apache-2.0
"""Campaigns that are tests, with the fixtures of `test`."""
