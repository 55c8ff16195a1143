"""Telling inputs, see `test_fuzz_corpus.py`."""
