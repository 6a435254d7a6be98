"""Logs as tables of numbers: one file per format, one table of formats."""
