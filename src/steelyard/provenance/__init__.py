"""Where results come from: the bytes that were read, the versions that computed, the command; and
whether they are still those.
"""
