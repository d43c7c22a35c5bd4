"""Plain second implementations of geometry, frames and inflation, for checks, soaks and tests."""
