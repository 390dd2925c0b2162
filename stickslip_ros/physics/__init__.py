# SPDX-License-Identifier: Apache-2.0
"""How the runner moves: parameters, friction laws, waveforms, the model and its solver."""
