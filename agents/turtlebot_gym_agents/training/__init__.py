"""Training with Stable-Baselines3: adapter, hyper-parameters and export."""
