# SPDX-License-Identifier: Apache-2.0
"""For tests with simulated axes: a pytest plugin, and behaviour that every driver should show.

pytest loads the plugin in every run where this package is installed, so nothing is imported here.
"""
