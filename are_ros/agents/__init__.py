"""Agents: the table of all artefacts alive, their decisions, and the sub-step that moves them."""
