"""Simple mistakes in a description or a log: each one an amendment of the experiment, a table of
those that an instrument may have, and the search for those that explain what does not agree;
imports the agreements, nothing else of the inspection.
"""
