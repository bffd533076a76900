"""Long computations behind the pages."""
