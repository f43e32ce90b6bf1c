"""Training with Stable-Baselines3: adapter, hyper-parameters, checkpoints and export."""
