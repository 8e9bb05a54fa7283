"""What is worked out beside a viewer, most of it in processes of its own."""
