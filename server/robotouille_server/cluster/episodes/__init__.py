"""Episodes of the cluster: their journals and directory, and who continues them."""
