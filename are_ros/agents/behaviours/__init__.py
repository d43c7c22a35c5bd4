"""What an artefact can want: small classes from a `Situation` to an `Intent`."""
