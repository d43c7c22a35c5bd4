"""What judges recordings and live runs, with arithmetic of its own."""
