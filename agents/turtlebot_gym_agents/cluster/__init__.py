"""Work split into units, which run here one after another or in parallel on a cluster, with the same results.

`units` runs units, and stores and reuses their results; `workers` are processes of this machine (joblib) or of a cluster (Ray).
`drives`, `trainings`, `search` and `grid` are the kinds of work.
"""
