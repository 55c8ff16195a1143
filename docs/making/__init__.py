"""What the documentation makes when it is built: pages of the catalogue, table of equations, pictures."""
