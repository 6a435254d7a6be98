"""Logs as tables of numbers: ``text``, ``messages`` and ``arrays``, one file per format, one table
of formats; damaged and hostile files end here in one sentence.

It knows nothing of robots and instruments, and imports arrays, errors, units and YAML only.
"""
