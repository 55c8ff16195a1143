"""Floor 4: one record over several processes, one model for each of many devices; needs Dask."""
