"""Many races at once: flown in processes of their own, by workers of a Dask cluster.

jobs.py says what is flown, worker.py flies it, cluster.py hands the races to the workers,
store.py keeps every result on disk, progress.py shows them, and summary.py, tables.py and
overview_plot.py make the numbers, the tables and the picture. Only cluster.py imports Dask.
"""
