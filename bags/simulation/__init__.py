"""The small robot in a made-up office that recorded the sample."""
