"""What a configuration means, in words and figures (`are describe`), and the parameter tables."""
