"""Farms: passes of frames as tasks on a Dask cluster, whose results are the bits of one machine."""
