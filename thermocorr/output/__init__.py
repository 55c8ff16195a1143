"""Floor 4: what a person or program gets: pictures, pages, files."""
