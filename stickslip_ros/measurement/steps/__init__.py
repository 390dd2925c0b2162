# SPDX-License-Identifier: Apache-2.0
"""Finds the runs of steps in a record of position, and measures step, backstep and ringing."""
