"""What a load test found: values, terminal, page and plots."""
