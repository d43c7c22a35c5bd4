"""The population: catalogue, mixture (Eq. 1), arrivals, departures, scenarios."""
