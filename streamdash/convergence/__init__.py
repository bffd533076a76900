"""Do the simulations converge? The tests of the paper's appendix A, and more."""
