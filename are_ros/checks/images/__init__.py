"""Augmented images beside their inputs, by code that shares nothing with what wrote them."""
