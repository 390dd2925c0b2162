# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests, for campaigns that are tests as well."""

pytest_plugins = ("stickslip_ros.testing", "shared_fixtures")
