# SPDX-License-Identifier: Apache-2.0
"""The rooms that add rows to the table of parameters.

`parameters` imports none of them by name: it uses this list when the table is first read.
"""

#: Modules that call `parameters.register`; they load neither numba nor numpy.
ROW_PROVIDERS = ("stickslip_ros.laws", "stickslip_ros.waveforms")
