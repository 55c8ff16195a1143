"""Floor 5: the outside world: command line, model files, live correction, clusters."""
