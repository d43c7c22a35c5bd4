"""What a configuration means, in words and plots."""
