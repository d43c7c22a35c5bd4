"""What a recording must satisfy, checked by code that shares nothing with what wrote it."""
