"""Episodes with those who play and watch them."""
