"""Files from anyone, read as data: bounded, checked against a model where there is one, with errors
that name file, line and key in one sentence.

It imports errors and display; what a file means is the business of the room that asks for it.
"""
