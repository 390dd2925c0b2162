# SPDX-License-Identifier: Apache-2.0
"""What a program or a notebook calls, with results that show themselves.

All of it is public in the package itself: ``import stickslip_ros as ss; ss.simulate()``.
"""
