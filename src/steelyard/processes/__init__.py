"""Processes beside this one, and whether this one may go on after a fork."""
