"""Mathematics that knows no robot: pytrees, vectors, small matrices, root finding, sums over many cases."""
