"""Work that is cut into units, which run here one after another or side by side on a cluster, with the same results.

`units` says what a unit is and does it, `store` keeps results as they come, `work` brings units and results together,
`ray_workers` is the only module that knows Ray.
"""
