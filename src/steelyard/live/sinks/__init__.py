"""Where estimates go to: one file each, one table of them all."""
