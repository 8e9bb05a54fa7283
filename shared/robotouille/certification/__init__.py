"""Certificates: what is proven about the instances of a dataset, and how it is checked."""
