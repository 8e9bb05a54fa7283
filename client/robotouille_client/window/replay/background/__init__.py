"""What is worked out beside a viewer, in processes of its own."""
