# SPDX-License-Identifier: Apache-2.0
"""The page of ``stickslip explore``: sliders for a drive, and curves that follow them."""
