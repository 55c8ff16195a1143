"""Floor 5: the outside world: command line, files."""
