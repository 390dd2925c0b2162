# SPDX-License-Identifier: Apache-2.0
"""Many operating points: sweeps, waveform searches, limits."""
