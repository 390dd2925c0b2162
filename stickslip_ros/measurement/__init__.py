# SPDX-License-Identifier: Apache-2.0
"""What a record says: read, its steps found, compared with a run; identification and twin below."""
