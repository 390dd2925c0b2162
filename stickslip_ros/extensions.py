# SPDX-License-Identifier: Apache-2.0
"""The rooms that bring rows of their own into the table of parameters.

`parameters` imports none of them by name: it goes by this list when the table is first read.
"""

#: Modules that call `parameters.register`; they load neither numba nor numpy.
ROW_PROVIDERS = ("stickslip_ros.laws", "stickslip_ros.waveforms")
