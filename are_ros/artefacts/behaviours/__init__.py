"""What artefacts do (section 3.2): small classes that look at a situation and want something."""
