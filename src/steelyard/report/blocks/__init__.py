"""What documents are built of: sentences, tables, figures and 3-D views as values, and how names,
units and lines look.

Of the package it imports arrays, digits and `evidence/values`, nothing that computes results.
"""
