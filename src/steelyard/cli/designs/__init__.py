"""What `design` proposes: imported only where it is asked for, since all of it is heavy."""
