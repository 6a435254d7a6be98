"""Samples of a run on one time base, for ``two-step`` and for a motion to begin with, and the noise
that force readings show. Imports the rooms left of it, `identification/model/` among them.
"""
