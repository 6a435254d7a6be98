"""The same experiment in another form: on one clock, or with the origin of the platform frame
elsewhere.

It imports the rest of `experiment/`; nothing there imports it.
"""
