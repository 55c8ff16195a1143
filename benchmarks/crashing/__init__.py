"""Parts of `benchmarks/crash.py`: processes that are ended, disks that are full, and what must be true afterwards."""
