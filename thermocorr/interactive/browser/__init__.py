"""What brings the bench before a person: a process that computes, a server on this machine, a notebook's widget."""
