"""Formats that hold named arrays in folders of folders: MATLAB, HDF5, NetCDF, npz."""
