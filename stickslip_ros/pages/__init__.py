# SPDX-License-Identifier: Apache-2.0
"""What results look like: a page for each kind, and the plots that pages and pictures show."""
