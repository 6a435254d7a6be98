"""Many experiments by one command: tasks for an engine that is there already, a row for each
experiment and method, and what the rows say when they are looked at together.
"""
