# SPDX-License-Identifier: Apache-2.0
"""What a run is over time: simulated steps, traces, readings of the sensor, phases of a step."""
