"""`estimate.json`, read back: its form, the values that it states, and files as people name
them.
"""
