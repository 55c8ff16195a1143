"""Choice of time constants: factors of a dense grid, folds in time, spectra, sets, and their refinement."""
