"""Parts of `benchmarks/fuzz.py`: what is mutated, what must come of it, and how an outcome is judged."""
