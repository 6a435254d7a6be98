"""Tables that belong to no motion: rows without time, kept apart from the runs they were listed
in.
"""
