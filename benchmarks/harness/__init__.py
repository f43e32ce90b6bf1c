"""The speed benchmark: contenders that take turns, peers in their own environments, and a guard against regressions."""
