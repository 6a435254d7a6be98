"""Where tasks are worked on: processes of this machine, Dask, SLURM; one file each."""
