"""Work split into units, which run here one after another or in parallel on a cluster, with the same results.

`units` defines and runs units, `store` keeps results as they arrive, `work` combines the two, and `ray_workers` is the only
module that uses Ray.
"""
