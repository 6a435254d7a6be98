"""Whether an estimate can be trusted: assessment, diagnosis of what is wrong, held-out prediction.

Imports model and solve.
"""
