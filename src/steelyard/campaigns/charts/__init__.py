"""What a series of estimates tells: whether the body has changed, and whether the stated sigma is
that by which recordings differ.
"""
