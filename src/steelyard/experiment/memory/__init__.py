"""Experiments of what is in memory: frames and arrays in place of files."""
