"""The sections of a report, one file each: from the summary to blocks, nothing else is looked
at.
"""
