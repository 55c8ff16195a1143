"""Floor 4: one model for each of many devices."""
