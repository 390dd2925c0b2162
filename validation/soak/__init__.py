# SPDX-License-Identifier: Apache-2.0
"""An axis and a recorder under random commands for hours."""
