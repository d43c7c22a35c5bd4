"""Behaviours: small classes that turn what an artefact knows (`Situation`) into an `Intent`."""
