"""Work split into units, which run here one after another or in parallel on a cluster, with the same results.

`units` runs units and reuses stored results, `store` keeps results as they arrive, and `workers` are processes of this machine
(joblib) or of a cluster (Ray). `drives`, `trainings`, `search` and `grid` are the kinds of work.
"""
