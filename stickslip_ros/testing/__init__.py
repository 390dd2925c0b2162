# SPDX-License-Identifier: Apache-2.0
"""For tests with simulated axes: a pytest plugin.

pytest loads the plugin in every run where this package is installed, so nothing is imported here.
"""
