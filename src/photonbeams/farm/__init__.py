"""Farms: render passes of frames as tasks on a Dask cluster, bit for bit as on one machine."""
