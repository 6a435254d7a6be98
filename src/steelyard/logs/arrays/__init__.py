"""Files of arrays in groups: HDF5, MATLAB, TDMS and NumPy; one group is one table."""
