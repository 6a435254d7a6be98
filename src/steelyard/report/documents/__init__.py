"""What there is to say, a file per subject: identification (with a file per section), inspection,
design, comparison and draft of an experiment file.

May import what it speaks of, `evidence/` and `blocks/`; it does not know how it is shown.
"""
