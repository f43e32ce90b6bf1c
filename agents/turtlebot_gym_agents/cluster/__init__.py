"""Work of several jobs: evaluations, trainings, studies and searches, with the same results in one process, several, or on Ray.

`workers` runs jobs, `ledger` remembers what is finished; `drives`, `trainings`, `grid` and `search` are the kinds of work.
"""
