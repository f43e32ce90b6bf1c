"""What the benchmarks share: studies with their results, contenders that take turns, and the machine."""
