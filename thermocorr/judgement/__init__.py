"""Floor 4: judgement. Empty so far: diagnosis and refinement will live here."""
