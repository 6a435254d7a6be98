"""Results for people: from an identification, an inspection or a design to pages and terminals.

`evidence/`, then `blocks/`, `documents/` and `forms/`: each imports only from those before it.
Here: what joins them, files (write), and for notebooks pictures (figures) and how far a call has
come (progress_bar). May import all but `cli`.
"""
