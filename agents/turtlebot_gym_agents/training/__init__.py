"""Training with Stable-Baselines3, and what belongs to it: adapter, hyper-parameters, checkpoints, export."""
