# SPDX-License-Identifier: Apache-2.0
"""Report pages, one for each kind of result, and the plots of pages and pictures."""
