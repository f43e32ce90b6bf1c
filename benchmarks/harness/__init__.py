"""What the benchmarks share: studies with their results, tables, and the machine."""
