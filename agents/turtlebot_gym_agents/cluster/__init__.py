"""Work of several jobs: evaluations, trainings and studies, with the same results in one process, several, or on Ray."""
