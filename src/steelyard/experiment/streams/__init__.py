"""Streams in SI from the columns of logs: where a stream is, which columns of its log it is read
from, and rotations in whatever form they stand there.
"""
