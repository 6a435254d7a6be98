"""The sections of the report of an identification, one file each.

A section is a function from the summary to a `Section`, or None where it has nothing to say;
it may import `evidence/` and `blocks/`, and looks at nothing else.
"""
