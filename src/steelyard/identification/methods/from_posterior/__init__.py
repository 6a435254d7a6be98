"""From a posterior to an estimate, whichever method draws it."""
