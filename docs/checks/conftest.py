# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests, for what `make lint` and `make site` check of pages and of packaging."""

pytest_plugins = ("stickslip_ros.testing", "shared_fixtures")
