"""Readings of a chunk that has just arrived: its motion, what stands alone, until it has
settled.
"""
