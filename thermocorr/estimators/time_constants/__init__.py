"""How time constants are chosen: factors of a dense grid, folds in time, spectra, sets, and their refinement."""
