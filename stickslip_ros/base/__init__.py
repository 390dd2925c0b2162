# SPDX-License-Identifier: Apache-2.0
"""What has nothing to do with friction: errors, files, compiling, tables, pages, pictures."""
