"""Measurement equations as expressions, built once from what an instrument states: what is read,
backwards, about a motion, and how what was found follows.

Expressions are evaluated over samples by :mod:`steelyard.instruments.equations`, and together by
rooms that take several at once.
"""
