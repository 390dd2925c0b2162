# SPDX-License-Identifier: Apache-2.0
"""The seam to recordings: the motion in a bag, and that of an axis of ours at a finer rate."""
