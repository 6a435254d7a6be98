"""Results for people: from an identification, an inspection or a design to pages and terminals.

`evidence/`, then `blocks/`, `documents/` and `forms/`: each imports only from those before it.
Here: what joins them, files (write) and pictures for notebooks (figures). May import all but `cli`.
"""
