"""The verbs, one file each: options and a few lines around library calls.

A verb imports what is heavy within its function, and nothing of another verb; what several share
stands in `cli/`.
"""
