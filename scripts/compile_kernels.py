"""Compile the kernels for the default parameters; `make demo` does so while it installs."""

import time

from are_ros.builder.assembly import catalogue_of
from are_ros.builder.warm_up import WarmUpNeeds, warm_up
from are_ros.messages.sensors import MINIATURES
from are_ros.parameters.model import Parameters

if __name__ == "__main__":
    started = time.monotonic()
    warm_up(catalogue_of(Parameters()), WarmUpNeeds(MINIATURES))
    print(f"the kernels are ready after {time.monotonic() - started:.0f} s", flush=True)
