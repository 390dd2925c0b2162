# SPDX-License-Identifier: Apache-2.0
"""The command ``stickslip``: one file for each subcommand."""
