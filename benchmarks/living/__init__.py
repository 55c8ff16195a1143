"""Parts of `benchmarks/live_cases.py`: random logs, and what the whole record says of their rows."""
