"""Offline trajectory planning: the whole physics and all limits, from start to end at once.

May import `softmpc.control` and what is below it.
"""
