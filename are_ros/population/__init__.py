"""Who comes, when, and for how long: the catalogue, the mixture, arrivals, lifetimes, scenarios."""
