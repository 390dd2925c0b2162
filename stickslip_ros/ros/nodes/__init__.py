# SPDX-License-Identifier: Apache-2.0
"""The nodes, and what they share with the client: messages, topics, processes."""
