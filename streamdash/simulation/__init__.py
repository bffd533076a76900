"""Ensembles of streams: inline, in worker processes or on Dask, resumable, and as background jobs."""
