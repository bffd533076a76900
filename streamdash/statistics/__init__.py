"""The statistics of observed streams: PDF, evidence, spectra, features, scores. Arrays only."""
